"""Compilation of kernels for the GPU, and the cache of machine code between runs.

As on the CPU, a kernel is identified by its content (model/base/digest.py), which is part of the name of its machine
code's file (model/base/kernel_cache.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import simulated
from softlab.model.base.digest import content_digest, file_name
from softlab.model.base.kernel_cache import NamedByContent, NotifyingCache, Place, attach_cache
from softlab.model.base.types import Compile, Real
from softlab.model.base.variant import Variant

if TYPE_CHECKING:
    from numba.cuda.cudadrv.driver import CudaPythonFunction as CudaFunction


class Kernel(Protocol):
    """A compiled kernel: `kernel[blocks, threads, stream, bytes of shared memory](*arguments)`."""

    def __getitem__(self, launch: tuple) -> Callable[..., None]: ...

    def typeof_pyval(self, value: object) -> object:
        """Return numba's type of an argument."""

    def compile(self, types: tuple[object, ...]) -> CompiledKernel:
        """Compile the kernel for arguments of these types."""


class CodeLibrary(Protocol):
    """numba's machine code of a kernel."""

    def get_cufunc(self) -> CudaFunction: ...


class CompiledKernel(Protocol):
    """A kernel for arguments of given types."""

    cooperative: bool
    _codelibrary: CodeLibrary

    def max_cooperative_grid_blocks(self, threads: int) -> int:
        """Return the number of blocks that the device runs at once."""


def variant_name(real: Real, *words: object) -> str:
    """Return a unique name of a kernel's variant, valid as a symbol. Sets are sorted."""
    parts = [np.dtype(real).name]
    for word in words:
        parts.extend(sorted(word) if isinstance(word, frozenset) else [str(word)])
    return "_".join(part.replace("-", "_") for part in parts)


def kernel_options(math: str) -> dict[str, bool]:
    """Return the options of cuda.jit for a math."""
    return {"fastmath": math == "fast"}


def inlined(math: str) -> Compile:
    """Return the decorator of device functions that take arrays in registers: a call would move them into local
    memory."""
    options = kernel_options(math)
    if not simulated():
        options["forceinline"] = True
    return cuda.jit(device=True, **options)


def make_kernel(function: Callable, variant: str, **options: object) -> Kernel:
    """Return cuda.jit(**options)(function), with its machine code cached on disk.

    Without a writable folder the kernel is compiled in each process (NUMBA_CACHE_DIR sets one). The simulator takes no
    options. `variant`: label of the kernel for readers; it need not be unique.
    """
    if simulated():
        return cuda.jit(function)
    label = f"{function.__name__} {variant}"
    function.__name__ = function.__qualname__ = file_name(f"{function.__name__}_{content_digest(function, options)}")
    kernel = cuda.jit(**options)(function)
    attach_cache(kernel, _kernel_cache(), label)
    return kernel


def make_kernels(functions: Iterable[Callable], variant: str, **options: object) -> SimpleNamespace:
    """Compile kernels, by the names of their functions."""
    return SimpleNamespace(**{function.__name__: make_kernel(function, variant, **options) for function in functions})


def kernels_of(variant: Variant, math: str, routines: Iterable[Callable], label: str) -> SimpleNamespace:
    """Compile kernels in a variant, by their names; `label` is for readers."""
    return make_kernels(map(variant.copied, routines), label, **kernel_options(math))


@cache
def _kernel_cache() -> type[NotifyingCache]:
    from numba.cuda.dispatcher import CUDACache, CUDACacheImpl

    class KernelFiles(NamedByContent, CUDACacheImpl):
        _locator_classes = [Place]  # noqa: RUF012

    class KernelCache(NotifyingCache, CUDACache):
        _impl_class = KernelFiles

    return KernelCache
