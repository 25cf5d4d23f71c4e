"""Check for a GPU that can run softlab; if there is none, the reason and the remedy."""

from __future__ import annotations

import os
from functools import cache
from typing import Protocol

import numpy as np

from softlab.model.base.errors import BackendUnavailable

SIMULATED_LIMITS = (1, 1 << 20)  # one block at a time runs there; shared memory is not limited
INSTALL = 'pip install -e ".[cuda13]" (NVIDIA driver 580 or newer) or ".[cuda12]" (older drivers), in the lab\'s folder'
SIMULATOR = "NUMBA_ENABLE_CUDASIM=1 runs the kernels, slowly, without a GPU"


class Stream(Protocol):
    """A CUDA stream; 0, the default one, in the simulator."""

    handle: int

    def __int__(self) -> int: ...

    def synchronize(self) -> None: ...


class Event(Protocol):
    """A place in the work of a stream."""

    def record(self, stream: Stream) -> None: ...

    def wait(self, stream: Stream) -> None: ...

    def query(self) -> bool: ...


class DeviceArray(Protocol):
    """An array in the device's memory; in the simulator an array of the host."""

    shape: tuple[int, ...]
    size: int

    def copy_to_host(self, ary: np.ndarray | None = None, stream: Stream | int = 0) -> np.ndarray: ...

    def copy_to_device(self, ary: np.ndarray | DeviceArray, stream: Stream | int = 0) -> None: ...

    def view(self, dtype: np.dtype | type) -> DeviceArray: ...

    def __getitem__(self, index: int | slice) -> DeviceArray: ...

    def __len__(self) -> int: ...


Argument = DeviceArray | np.generic | int | float | tuple  # of a kernel; a tuple is a group of them
Arguments = tuple[Argument, ...]


def simulated() -> bool:
    """Return True if numba's CUDA simulator replaces a GPU."""
    return os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("0", "")


ALIGNMENT = None if simulated() else 16  # of shared memory: a pair of float64 in one access; not for the simulator


@cache
def _probe() -> tuple[str, str]:
    """Return ("", the device's name) or (the reason, the remedy)."""
    try:
        from numba import cuda
    except ImportError as error:
        return f"no CUDA support is installed ({error})", INSTALL
    if simulated():
        return "", "CUDA simulator"
    try:
        if not cuda.is_available():
            return "no NVIDIA GPU or driver was found", f"on a machine with one: {INSTALL}; {SIMULATOR}"
        name = cuda.get_current_device().name
        return "", name.decode() if isinstance(name, bytes) else str(name)
    except Exception as error:  # drivers fail in many ways; any failure means: no GPU
        return f"the NVIDIA driver does not answer ({type(error).__name__}: {error})", INSTALL


def gpu_available() -> tuple[bool, str]:
    """Return (True, the device's name) or (False, the reason and the remedy)."""
    missing, text = _probe()
    return (False, f"{missing}; {text}") if missing else (True, text)


def require_gpu() -> str:
    """Return the device's name. Raises BackendUnavailable without a GPU, or if it cannot run numba's code."""
    missing, text = _probe()
    if missing:
        raise BackendUnavailable(missing, text)
    return text


def unsupported_code(error: BaseException) -> BackendUnavailable | None:
    """Return the error for the user if compiling or loading a kernel failed due to the installation, else None."""
    text = f"{type(error).__name__}: {error}"
    if "UNSUPPORTED_PTX" in text or "unsupported toolchain" in text or "PTX was compiled" in text:
        return BackendUnavailable(
            "the CUDA toolkit is newer than the driver",
            'pin the toolkit to the driver\'s version, such as pip install "cuda-toolkit==13.0.*" (nvidia-smi shows it)',
        )
    if any(word in text for word in ("DynamicLibNotFound", "NvvmSupportError", "libnvrtc", "NvrtcSupport")):
        return BackendUnavailable("the CUDA compiler is not installed", INSTALL)
    return None


def memory_info() -> tuple[int, int]:
    """Return (free, total) bytes of the GPU's memory."""
    from numba import cuda

    info = cuda.current_context().get_memory_info()
    return int(info[0]), int(info[1])


def device_limits() -> tuple[int, int]:
    """Return (multiprocessors, bytes of shared memory that a block can have)."""
    if simulated():
        return SIMULATED_LIMITS
    from numba import cuda

    device = cuda.get_current_device()
    return int(device.MULTIPROCESSOR_COUNT), int(device.MAX_SHARED_MEMORY_PER_BLOCK_OPTIN)
