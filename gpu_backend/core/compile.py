"""Compiling kernels for the GPU, and keeping the machine code between runs.

As on the CPU, a kernel is known by what it is made of (model/core/digest.py), which is in the name of the file in which its
machine code is kept (model/core/kernel_cache.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.device import simulated
from model.core.digest import content_digest, file_name
from model.core.kernel_cache import Kept, NamedByContent, Place, keep


def variant_name(real: Any, *words: object) -> str:
    """A name, fit for a symbol, that tells every variant of a kernel apart. Sets are spelt in order."""
    parts = [np.dtype(real).name]
    for word in words:
        parts.extend(sorted(word) if isinstance(word, frozenset) else [str(word)])
    return "_".join(part.replace("-", "_") for part in parts)


def kernel_options(math: str) -> dict[str, Any]:
    """Options of cuda.jit for a math."""
    return {"fastmath": math == "fast"}


def inlined(math: str) -> Any:
    """Decorator of device functions that take arrays in registers: a call would push them into local memory."""
    options = kernel_options(math)
    if not simulated():
        options["forceinline"] = True
    return cuda.jit(device=True, **options)


def make_kernel(function: Callable, variant: str, **options: Any) -> Any:
    """cuda.jit(**options)(function), its machine code kept on disk. Without a writable folder the kernel is compiled in each
    process anew (NUMBA_CACHE_DIR mends it). The simulator takes no options.

    `variant`: what the kernel is called where people read of it; it need not tell variants apart.
    """
    if simulated():
        return cuda.jit(function)
    label = f"{function.__name__} {variant}"
    function.__name__ = function.__qualname__ = file_name(f"{function.__name__}_{content_digest(function, options)}")
    kernel = cuda.jit(**options)(function)
    keep(kernel, _kernel_cache(), label)
    return kernel


def make_kernels(functions: Iterable[Callable], variant: str, **options: Any) -> SimpleNamespace:
    """Kernels by the names of their functions."""
    return SimpleNamespace(**{function.__name__: make_kernel(function, variant, **options) for function in functions})


@cache
def _kernel_cache() -> Any:
    from numba.cuda.dispatcher import CUDACache, CUDACacheImpl

    class KernelFiles(NamedByContent, CUDACacheImpl):
        _locator_classes = [Place]  # type: ignore[list-item]  # noqa: RUF012

    class KernelCache(Kept, CUDACache):
        _impl_class = KernelFiles

    return KernelCache
