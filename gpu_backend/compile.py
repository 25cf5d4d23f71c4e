"""Compiling kernels for the GPU, and keeping the machine code between runs.

numba's own cache keys a kernel by its closure, which here holds other compiled functions and so differs in every
process. Kernels are keyed by what they were made from: the variant's name, and a hash of the sources of the formulas
and of this backend. (The CPU backend does the same with numba's other cache.)
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numba import cuda

import model.cloth_record
import model.contact_record
import model.formulas
import model.implicit_record
import model.particle_contact_record
import model.record
import model.xpbd_plan
import model.xpbd_record
from gpu_backend.device import simulated
from model.digest import file_name, source_digest


def variant_name(real: Any, *words: object) -> str:
    """A name, fit for a symbol, that tells every variant of a kernel apart. Sets are spelt in order."""
    parts = [np.dtype(real).name]
    for word in words:
        parts.extend(sorted(word) if isinstance(word, frozenset) else [str(word)])
    return "_".join(part.replace("-", "_") for part in parts)


@cache
def _digest() -> str:
    here = Path(__file__).parent
    records = (
        Path(str(m.__file__))
        for m in (
            model.record,
            model.cloth_record,
            model.contact_record,
            model.implicit_record,
            model.particle_contact_record,
            model.xpbd_record,
            model.xpbd_plan,
        )
    )
    return source_digest(Path(model.formulas.__file__).parent, *records, here)


def make_kernel(function: Callable, variant: str, **options: Any) -> Any:
    """cuda.jit(**options)(function), its machine code kept on disk under the variant's name.

    `variant` must hold everything that the function's closure depends on. Without a writable folder the kernel is
    compiled in each process anew (NUMBA_CACHE_DIR mends it). The simulator takes no options.
    """
    if simulated():
        return cuda.jit(function)
    function.__name__ = function.__qualname__ = file_name(f"{function.__name__}_{variant}")
    kernel = cuda.jit(**options)(function)
    with suppress(RuntimeError, ImportError):
        kernel._cache = _variant_cache()(function)
    return kernel


@cache
def _variant_cache() -> Any:
    from numba.cuda.dispatcher import CUDACache

    class VariantCache(CUDACache):
        def _index_key(self, sig: Any, codegen: Any) -> Any:
            return sig, codegen.magic_tuple(), self._py_func.__qualname__, _digest()

    return VariantCache
