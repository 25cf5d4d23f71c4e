"""Compiling the formulas and kernels for the CPU, and keeping the machine code between runs.

A function is known by what it is made of (model/digest.py): two factories that make the same function share one, whatever
they call their variant, and what a kernel is made of is in the name of the file in which its machine code is kept
(model/kernel_cache.py).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numba
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.compiler import Compiler as NumbaCompiler

import cpu_backend.plain  # noqa: F401  # which the environment may switch on
from cpu_backend.progress import new_team
from model.digest import content_digest, file_name
from model.kernel_cache import Kept, NamedByContent, Place, keep

# What `fast` allows. Not `reassoc`, which would cancel the (p' - p) of the hand-out's step; not `nnan` and `ninf`, since
# a diverging state must stay visible.
FAST = frozenset({"contract", "arcp", "afn", "nsz"})


class _KernelFiles(NamedByContent, CompileResultCacheImpl):
    _locator_classes = [Place]  # type: ignore[list-item]  # noqa: RUF012


class _KernelCache(Kept, FunctionCache):
    _impl_class = _KernelFiles


class _RowPipeline(NumbaCompiler):
    """numba's pipeline for functions whose array arguments share no memory that is written.

    LLVM is told so. Else it checks at run time whether the arrays overlap, which takes longer than a short row, and
    above a handful of arrays it does not vectorise at all.
    """

    def define_pipelines(self) -> Any:
        self.state.flags.noalias = True
        return super().define_pipelines()


_shared: dict[str, Any] = {}  # functions that kernels call, by what they are made of


class Compiler:
    """Decorators for one arithmetic: `compiled` for formulas and helpers, `row` for loops along a row, `kernel` for what
    Python calls. `variant`: what a kernel is called where people read of it; it need not tell variants apart."""

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
        return self._made_once(function)

    def inlined(self, function: Callable) -> Any:
        """As `compiled`, for functions of so many arguments that passing them costs more than a short row."""
        return self._made_once(function, forceinline=True)

    def row(self, function: Callable) -> Any:
        """A loop along rows. Its array arguments must not overlap, except for those that it only reads."""
        return self._made_once(function, pipeline_class=_RowPipeline)

    def kernel(self, function: Callable) -> Any:
        """A parallel kernel whose machine code is kept on disk; without a writable place it is compiled each time."""
        label = f"{function.__name__} {self.variant}"
        named(function, content_digest(function, self.options))
        dispatcher = numba.njit(parallel=True, **self.options)(function)
        keep(dispatcher, _KernelCache, label)
        return dispatcher

    def team(self, function: Callable) -> Any:
        """A parallel kernel (bands, ...) of one region, in which every member runs `function` (team, member, bands, ...): see
        progress.shares. Arguments are numbers and arrays, no tuples."""
        name = function.__name__
        run = self.compiled(function)

        def team(bands, *given):
            flags = new_team(bands)
            for member in numba.prange(bands):
                run(flags, np.int64(member), bands, *given)

        team.__name__ = f"team_{name}"
        return self.kernel(team)

    def _made_once(self, function: Callable, **options: Any) -> Any:
        content = content_digest(function, self.options, options)
        if content not in _shared:
            _shared[content] = numba.njit(**self.options, **self._inner, **options)(named(function, content))
            _shared[content].softlab_content = content
        return _shared[content]


def named(function: Callable, content: str) -> Callable:
    """The function under a name that holds its content, so that no two share a symbol or a file of machine code."""
    function.__name__ = function.__qualname__ = file_name(f"{function.__name__}_{content}")
    return function


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
