"""Assignment of a sheet's windows to GPUs, and access between their memories."""

from __future__ import annotations

import atexit
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

from numba import cuda

from softlab.gpu_backend.core.device import Event, require_gpu, simulated
from softlab.model.base.errors import BackendUnavailable

if TYPE_CHECKING:
    from numba.cuda.cudadrv.driver import Module

OVERSUBSCRIBE = "SOFTLAB_SHARE_GPU"  # set to 1: more windows than GPUs share the available ones
ALREADY_ENABLED = 704  # CUDA_ERROR_PEER_ACCESS_ALREADY_ENABLED


def gpu_count() -> int:
    """Return the number of GPUs of this machine; 1 under the simulator. Raises BackendUnavailable if there is none."""
    require_gpu()
    return len(cuda.gpus)


def sharing() -> bool:
    """Return True if windows may share a GPU: to try a decomposition with fewer GPUs than windows."""
    return simulated() or os.environ.get(OVERSUBSCRIBE, "0") not in ("0", "")


def devices_for(count: int) -> list[int]:
    """Return the number of the GPU of each of `count` windows. Raises BackendUnavailable if there are too few.

    With several GPUs, memory that numba would free twice at the end of the process is freed once.
    """
    here = gpu_count()
    if count > here and not sharing():
        raise BackendUnavailable(
            f"{count} GPUs were requested, and {here} {'is' if here == 1 else 'are'} here",
            f"use --gpus {here}, or {OVERSUBSCRIBE}=1, which lets windows alternate on one GPU, for tests",
        )
    if min(count, here) > 1:
        _unload_once_at_exit()
    return [k % here for k in range(count)]


@cache
def _unload_once_at_exit() -> None:
    """Register `unload_once` before numba's own exit: the last registered function runs first."""

    def end() -> None:
        used = (gpu.primary_context for gpu in cuda.gpus)
        unload_once(context.modules for context in used if context is not None)

    atexit.register(end)


def unload_once(modules: Iterable[Mapping[object, Module]]) -> None:
    """Make one GPU only unload each library of kernels; `modules`: the libraries that each GPU has loaded.

    numba-cuda 0.30.4 loads a library of kernels once for all GPUs, but records it as loaded by each that runs one, and
    unloads it at the end of the process as often: "double free or corruption".
    """
    seen = set()
    for loaded in modules:
        for module in loaded.values():
            library = int(module.handle)
            if library in seen:
                module._finalizer.detach()
            seen.add(library)


def at(device: int) -> AbstractContextManager[object]:
    """Return the context in which work is queued on GPU number `device`."""
    context: AbstractContextManager[object] = cuda.gpus[device]
    return context


def new_event() -> Event | None:
    """Return an event of the current GPU, without timing; None under the simulator, whose streams are always done."""
    return None if simulated() else cuda.event(timing=False)


def connect(devices: Sequence[int]) -> None:
    """Let neighbours read and write each other's memory. Raises BackendUnavailable if the hardware does not support
    it."""
    if simulated():
        return
    for one, other in pairwise(devices):
        for here, there in ((one, other), (other, one)):
            if here != there:
                _enable(here, there)


def can_access(here: int, there: int) -> bool:
    """Return True if GPU `here` can read and write the memory of GPU `there`."""
    with at(here):
        return bool(cuda.current_context().can_access_peer(there))


def _enable(here: int, there: int) -> None:
    from numba.cuda.cudadrv.driver import CudaAPIError

    if not can_access(here, there):
        raise BackendUnavailable(
            f"GPU {here} has no access to the memory of GPU {there}",
            "use --link nccl or --gpus 1; softlab doctor shows how they are linked",
        )
    with at(there):
        other = cuda.current_context().handle
    with at(here):
        try:
            cuda.current_context().enable_peer_access(other)
        except CudaAPIError as error:
            if int(error.code) != ALREADY_ENABLED:
                raise
