"""Compilation of formulas and kernels for the CPU, and the cache of machine code between runs.

A function is identified by its content (model/base/digest.py): two factories that make the same function share one,
whatever the name of their variant, and the content of a kernel is part of the name of its machine code's file
(model/base/kernel_cache.py).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, TypedDict

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.compiler_machinery import PassManager

from softlab.cpu_backend.core.plain import in_python, still_time, translated
from softlab.cpu_backend.core.progress import new_team
from softlab.cpu_backend.core.region import BodyPipeline, LinkedPipeline, packed, region
from softlab.model.base.digest import content_digest, file_name, source_digest
from softlab.model.base.kernel_cache import NamedByContent, NotifyingCache, Place, attach_cache
from softlab.model.base.types import Features, Real
from softlab.model.base.variant import Formulas, Variant

# Optimisations of `fast`. Not `reassoc`, which would cancel the (p' - p) of the hand-out's step; not `nnan` and `ninf`,
# since a diverging state must stay visible.
FAST = frozenset({"contract", "arcp", "afn", "nsz"})


class JitOptions(TypedDict, total=False):
    """Options of numba.njit."""

    fastmath: bool | set[str]
    error_model: Literal["python", "numpy"]
    nogil: bool
    forceinline: bool


class _KernelFiles(NamedByContent, CompileResultCacheImpl):
    _locator_classes = [Place]  # type: ignore[list-item]  # noqa: RUF012


class _KernelCache(NotifyingCache, FunctionCache):
    _impl_class = _KernelFiles


class _RowPipeline(LinkedPipeline):
    """The numba pipeline of functions whose array arguments do not overlap if they are written.

    It tells LLVM so. Otherwise LLVM checks at run time whether the arrays overlap, which takes longer than a short row,
    and for more than a handful of arrays it does not vectorise at all.
    """

    def define_pipelines(self) -> list[PassManager]:
        self.state.flags.noalias = True
        return super().define_pipelines()


# How functions are compiled, which is not part of their own content: pipelines and libraries.
_HOW = source_digest(*(Path(__file__).with_name(f"{name}.py") for name in ("compile", "region", "subnormals")))
_shared: dict[str, Callable] = {}  # functions that kernels call, by their content


class Compiler:
    """Decorators for one arithmetic: `compiled` for formulas and helpers, `row` for loops along a row, `kernel` for
    functions that Python calls. `variant`: label of a kernel for readers; it need not be unique."""

    def __init__(self, variant: str, math: str):
        self.variant = variant
        self.options: JitOptions = {
            "fastmath": set(FAST) if math == "fast" else False,
            "error_model": "numpy",  # by default every quotient has a branch that prevents vectorisation
            "nogil": True,
        }
        # They are only called from kernels: without wrappers for Python and C a variant compiles in 4/5 of the time.
        # They allocate nothing, so no reference counting is needed.
        self._variants: dict[tuple[object, ...], Variant] = {}
        self._inner: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "_nrt": False}

    def compiled(self, function: Callable) -> Callable:
        return self._compiled_once(function)

    def inlined(self, function: Callable) -> Callable:
        """Compile as `compiled`, for functions with so many arguments that passing them costs more than a short row."""
        return self._compiled_once(function, inline=True)

    def formulas(
        self, module: ModuleType, real: Real, features: Features | None = None, inline: bool = False
    ) -> Formulas:
        """Return the formulas of a module in a variant."""
        return self.variant_of(real, features, inline).of(module)

    def variant_of(self, real: Real, features: Features | None = None, inline: bool = False) -> Variant:
        """Return the compiler of formulas in a precision, `compiled` or `inlined`; see model/base/variant.py."""
        variant = real, inline, frozenset((features or {}).items())
        if variant not in self._variants:
            ways = {"row": self.row, "inlined": self.inlined}
            self._variants[variant] = Variant(real, self.inlined if inline else self.compiled, features, ways=ways)
        return self._variants[variant]

    def row(self, function: Callable) -> Callable:
        """Compile a loop along rows. Its array arguments must not overlap, except for those that it only reads."""
        return self._compiled_once(function, pipeline_class=_RowPipeline)

    def body(self, function: Callable) -> Callable:
        """Compile a part of a parallel kernel's body, which is optimised with the kernel and not on its own."""
        return self._compiled_once(function, BodyPipeline)

    def kernel(self, function: Callable, parallel: bool = True) -> Callable:
        """Compile a parallel kernel, cached on disk; without a writable folder it is compiled each time."""
        label = f"{function.__name__} {self.variant}"
        named(function, content_digest(function, self.options, _HOW))
        dispatcher = numba.njit(parallel=parallel, **self.options)(function)
        attach_cache(dispatcher, _KernelCache, label)
        return dispatcher

    def team(self, function: Callable) -> Callable:
        """Compile a parallel kernel (bands, ...) of one region, in which every member runs `function` (team, member,
        bands, ...).

        See progress.assigned. Arguments are numbers, arrays and tuples of them.
        """
        name, run, all_members = self._inside(function)

        def team(bands, *values):
            flags = new_team(bands)
            entry, arguments = packed(run, (flags,), bands, values)
            all_members(entry, arguments, bands)
            flags[0, 1] = bands  # keeps them alive until here

        team.__name__ = f"team_{name}"
        kernel = self.kernel(team, parallel=False)

        @in_python(kernel)
        def one_after_the_other(bands: int, *values: object) -> None:
            flags = translated(new_team)(bands)
            for member in range(bands):
                still_time()
                translated(run)(flags, member, bands, *values)

        return kernel

    def banded(self, function: Callable) -> Callable:
        """Compile a parallel kernel (bands, ...) that runs `function` (band, bands, ...) for all bands, in any
        order."""
        name, run, all_members = self._inside(function)

        def banded(bands, *values):
            entry, arguments = packed(run, (), bands, values)
            all_members(entry, arguments, bands)

        banded.__name__ = f"banded_{name}"
        kernel = self.kernel(banded, parallel=False)

        @in_python(kernel)
        def one_after_the_other(bands: int, *values: object) -> None:
            for band in range(bands):
                still_time()
                translated(run)(band, bands, *values)

        return kernel

    def _inside(self, function: Callable) -> tuple[str, Callable, Callable]:
        """Return the components of a parallel kernel: name, function of a member or band, parallel region."""
        known = getattr(function, "softlab_content", None)
        name = function.__name__.removesuffix(f"_{known}")
        return name, function if known else self.body(function), _region()

    def _compiled_once(
        self, function: Callable, pipeline_class: type[LinkedPipeline] = LinkedPipeline, inline: bool = False
    ) -> Callable:
        options: dict[str, Any] = {"forceinline": True} if inline else {}
        content = content_digest(function, self.options, options, pipeline_class.__name__, _HOW)
        if content not in _shared:
            compiled = numba.njit(**self.options, **self._inner, **options, pipeline_class=pipeline_class)(
                named(function, content)
            )
            compiled.__dict__["softlab_content"] = content
            _shared[content] = compiled
        return _shared[content]


def named(function: Callable, content: str) -> Callable:
    """Rename the function by its content, so that no two share a symbol or a file of machine code."""
    function.__name__ = function.__qualname__ = file_name(f"{function.__name__}_{content}")
    return function


@cache
def _region() -> Callable:
    return Compiler("of every team", "exact").kernel(region)


@cache
def _empty_region() -> Callable:
    def region(n):
        total = 0
        for k in numba.prange(n):
            total += k
        return total

    return Compiler("empty", "exact").kernel(region)


def start_threads() -> None:
    """Run one parallel region, so that numba chooses its threading layer."""
    _empty_region()(1)
