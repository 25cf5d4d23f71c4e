"""Compiling the formulas and kernels for the CPU, and keeping the machine code between runs.

A function is known by what it is made of (model/core/digest.py): two factories that make the same function share one,
whatever they call their variant, and what a kernel is made of is in the name of the file in which its machine code is kept
(model/core/kernel_cache.py).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache

from cpu_backend.core.plain import in_python, still_time, translated
from cpu_backend.core.progress import new_team
from cpu_backend.core.region import BodyPipeline, LinkedPipeline, packed, region
from model.core.digest import content_digest, file_name, source_digest
from model.core.kernel_cache import Kept, NamedByContent, Place, keep

# What `fast` allows. Not `reassoc`, which would cancel the (p' - p) of the hand-out's step; not `nnan` and `ninf`, since
# a diverging state must stay visible.
FAST = frozenset({"contract", "arcp", "afn", "nsz"})


class _KernelFiles(NamedByContent, CompileResultCacheImpl):
    _locator_classes = [Place]  # type: ignore[list-item]  # noqa: RUF012


class _KernelCache(Kept, FunctionCache):
    _impl_class = _KernelFiles


class _RowPipeline(LinkedPipeline):
    """numba's pipeline for functions whose array arguments share no memory that is written.

    LLVM is told so. Else it checks at run time whether the arrays overlap, which takes longer than a short row, and
    above a handful of arrays it does not vectorise at all.
    """

    def define_pipelines(self) -> Any:
        self.state.flags.noalias = True
        return super().define_pipelines()


# How functions are compiled, which their own content does not tell: pipelines and libraries.
_HOW = source_digest(Path(__file__), Path(__file__).with_name("region.py"))
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

    def kernel(self, function: Callable, parallel: bool = True) -> Any:
        """A parallel kernel whose machine code is kept on disk; without a writable place it is compiled each time."""
        label = f"{function.__name__} {self.variant}"
        named(function, content_digest(function, self.options, _HOW))
        dispatcher = numba.njit(parallel=parallel, **self.options)(function)
        keep(dispatcher, _KernelCache, label)
        return dispatcher

    def team(self, function: Callable) -> Any:
        """A parallel kernel (bands, ...) of one region, in which every member runs `function` (team, member, bands, ...): see
        progress.shares. Arguments are numbers, arrays and tuples of them."""
        name, run, all_members = self._inside(function)

        def team(bands, *given):
            flags = new_team(bands)
            entry, arguments = packed(run, (flags,), bands, given)
            all_members(entry, arguments, bands)
            flags[0, 1] = bands  # so that they live until here

        team.__name__ = f"team_{name}"
        kernel = self.kernel(team, parallel=False)

        @in_python(kernel)
        def one_after_the_other(bands: int, *given: Any) -> None:
            flags = translated(new_team)(bands)
            for member in range(bands):
                still_time()
                translated(run)(flags, member, bands, *given)

        return kernel

    def banded(self, function: Callable) -> Any:
        """A parallel kernel (bands, ...) that runs `function` (band, bands, ...) for every band, in any order."""
        name, run, all_members = self._inside(function)

        def banded(bands, *given):
            entry, arguments = packed(run, (), bands, given)
            all_members(entry, arguments, bands)

        banded.__name__ = f"banded_{name}"
        kernel = self.kernel(banded, parallel=False)

        @in_python(kernel)
        def one_after_the_other(bands: int, *given: Any) -> None:
            for band in range(bands):
                still_time()
                translated(run)(band, bands, *given)

        return kernel

    def _inside(self, function: Any) -> tuple[str, Any, Any]:
        """What a parallel kernel is made of: its name, what each member or band runs, and what starts them."""
        known = getattr(function, "softlab_content", None)
        name = function.__name__.removesuffix(f"_{known}")
        return name, function if known else self._made_once(function, BodyPipeline), _region()

    def _made_once(self, function: Callable, pipeline_class: Any = LinkedPipeline, **options: Any) -> Any:
        content = content_digest(function, self.options, options, pipeline_class.__name__, _HOW)
        if content not in _shared:
            _shared[content] = numba.njit(**self.options, **self._inner, **options, pipeline_class=pipeline_class)(
                named(function, content)
            )
            _shared[content].softlab_content = content
        return _shared[content]


def named(function: Callable, content: str) -> Callable:
    """The function under a name that holds its content, so that no two share a symbol or a file of machine code."""
    function.__name__ = function.__qualname__ = file_name(f"{function.__name__}_{content}")
    return function


@cache
def _region() -> Any:
    return Compiler("of every team", "exact").kernel(region)


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
