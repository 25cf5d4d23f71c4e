"""Compiling the formulas and kernels for the CPU, and keeping the machine code between runs.

numba's own cache keys a function by its closure, which here holds other compiled functions and so differs in every
process, and ignores the flags and the sources of what it calls. Kernels here are keyed by what they were made from: the
variant's name (precision, math, integrator, parts) and a hash of the sources of the formulas and of this backend.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core.caching import FunctionCache
from numba.core.compiler import Compiler as NumbaCompiler

import model.cloth_record
import model.contact_record
import model.formulas
import model.implicit_record
import model.particle_contact_record
import model.record
import model.xpbd_plan
import model.xpbd_record
from cpu_backend.progress import new_team
from model.digest import file_name, source_digest

# What `fast` allows. Not `reassoc`, which would cancel the (p' - p) of the hand-out's step; not `nnan` and `ninf`, since
# a diverging state must stay visible.
FAST = frozenset({"contract", "arcp", "afn", "nsz"})


@cache
def backend_digest() -> str:
    """A hash of the sources that this backend's machine code is made from."""
    records = (
        model.record, model.cloth_record, model.contact_record, model.implicit_record, model.xpbd_record, model.xpbd_plan,
        model.particle_contact_record,
    )  # fmt: skip
    return source_digest(
        Path(model.formulas.__file__).parent, *(Path(str(m.__file__)) for m in records), Path(__file__).parent
    )


class _VariantCache(FunctionCache):
    """numba's on-disk cache, keyed by the variant and the sources instead of the closure."""

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (sig, codegen.magic_tuple(), self._py_func.__qualname__, backend_digest())


class _RowPipeline(NumbaCompiler):
    """numba's pipeline for functions whose array arguments share no memory that is written.

    LLVM is told so. Else it checks at run time whether the arrays overlap, which takes longer than a short row, and
    above a handful of arrays it does not vectorise at all.
    """

    def define_pipelines(self) -> Any:
        self.state.flags.noalias = True
        return super().define_pipelines()


def named(function: Callable, variant: str) -> Callable:
    """The function under a name that holds its variant, so that no two variants share a symbol or a cache file."""
    function.__name__ = file_name(f"{function.__name__}_{variant}")
    function.__qualname__ = function.__name__
    return function


class Compiler:
    """Decorators for one variant: `compiled` for formulas and helpers, `row` for loops along a row, `kernel` for what
    Python calls."""

    def __init__(self, variant: str, math: str):
        self.variant = variant
        self.options: dict[str, Any] = {
            "fastmath": set(FAST) if math == "fast" else False,
            "error_model": "numpy",  # without it every quotient keeps a branch that stops vectorisation
            "nogil": True,
        }
        # only ever called from kernels: without wrappers for Python and C a variant compiles in four fifths of the time;
        # and they allocate nothing, so that there is nothing to count references of
        self._inner: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "_nrt": False}

    def compiled(self, function: Callable) -> Any:
        return numba.njit(**self.options, **self._inner)(named(function, self.variant))

    def inlined(self, function: Callable) -> Any:
        """As `compiled`, for functions of so many arguments that passing them costs more than a short row."""
        return numba.njit(**self.options, **self._inner, forceinline=True)(named(function, self.variant))

    def row(self, function: Callable) -> Any:
        """A loop along rows. Its array arguments must not overlap, except for those that it only reads."""
        return numba.njit(**self.options, **self._inner, pipeline_class=_RowPipeline)(named(function, self.variant))

    def kernel(self, function: Callable) -> Any:
        """A parallel kernel whose machine code is kept on disk; without a writable place it is compiled each time."""
        dispatcher = numba.njit(parallel=True, **self.options)(named(function, self.variant))
        with suppress(RuntimeError):  # no writable folder: NUMBA_CACHE_DIR mends it, `softlab doctor` says so
            dispatcher._cache = _VariantCache(dispatcher.py_func)
        return dispatcher

    def team(self, function: Callable) -> Any:
        """A parallel kernel (bands, ...) of one region, in which every member runs `function` (team, member, bands, ...): see
        progress.shares. Arguments are numbers and arrays, no tuples."""
        run = self.compiled(function)

        def team(bands, *given):
            flags = new_team(bands)
            for member in numba.prange(bands):
                run(flags, np.int64(member), bands, *given)

        team.__name__ = f"team_{function.__name__}"
        return self.kernel(team)


@cache
def _empty_region() -> Any:
    def region(n):
        total = 0
        for k in numba.prange(n):
            total += k
        return total

    return Compiler("empty", "exact").kernel(region)


def start_threads() -> None:
    """Run one parallel region, so that the threading layer is chosen."""
    _empty_region()(1)


def can_cache() -> bool:
    """Whether machine code can be kept on disk; NUMBA_CACHE_DIR names a folder where it cannot."""
    try:
        _VariantCache(can_cache)
    except RuntimeError:
        return False
    return True
