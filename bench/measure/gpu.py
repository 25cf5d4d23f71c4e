"""The GPU of this machine: whether there is one, its facts, and its NVML handle."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

FACTS = (
    "gpu", "gpu_count", "gpu_memory_gib", "gpu_compute_capability", "gpu_multiprocessors", "gpu_l2_bytes", "gpu_driver",
)  # fmt: skip


def gpu_or_reason() -> tuple[bool, str]:
    """Return (True, the device's name), or (False, why there is none and the remedy)."""
    try:
        from softlab.gpu_backend.core.device import gpu_available
    except ImportError as error:
        return False, f"the GPU backend cannot be loaded ({error})"
    return gpu_available()


def gpu_simulated() -> bool:
    """True if numba's CUDA simulator replaces the GPU: good for checks, never for times."""
    return os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("0", "")


def gpu_facts() -> dict[str, Any]:
    """Return the FACTS of the GPU for the record of a machine; None if unknown, or without a GPU."""
    facts: dict[str, object] = dict.fromkeys(FACTS)
    available, name = gpu_or_reason()
    if not available:
        return facts
    facts["gpu"] = name
    if gpu_simulated():
        return facts
    from numba import cuda

    device = cuda.get_current_device()
    return facts | {
        "gpu_count": len(cuda.gpus),
        "gpu_memory_gib": round(cuda.current_context().get_memory_info()[1] / 2**30),
        "gpu_compute_capability": ".".join(map(str, device.compute_capability)),
        "gpu_multiprocessors": int(device.MULTIPROCESSOR_COUNT),
        "gpu_l2_bytes": int(device.L2_CACHE_SIZE),
        "gpu_driver": _driver(),
    }


def nvml(number: int | None = None) -> tuple[Any, Any]:
    """Return (NVML, its handle of the device that numba uses: the only one, or the one of its name; or of numba's
    device `number`); None both, which can do nothing, where it cannot be had."""
    try:
        import pynvml

        pynvml.nvmlInit()
        if pynvml.nvmlDeviceGetCount() == 1:
            return pynvml, pynvml.nvmlDeviceGetHandleByIndex(0)
        from numba import cuda

        device = cuda.get_current_device() if number is None else cuda.gpus[number]
        return pynvml, pynvml.nvmlDeviceGetHandleByUUID(device.uuid)
    except Exception:  # the library is optional, and fails in as many ways as drivers do
        return None, None


def _driver() -> str | None:
    """Return the driver's version, or its CUDA version, if either is known."""
    library, _ = nvml()
    with suppress(Exception):  # as above
        version = library.nvmlSystemGetDriverVersion()
        return version.decode() if isinstance(version, bytes) else str(version)
    try:
        match = re.search(r"\b(\d{3}\.\d+(\.\d+)?)\b", Path("/proc/driver/nvidia/version").read_text())
        return match.group(1) if match else None
    except OSError:
        return None
