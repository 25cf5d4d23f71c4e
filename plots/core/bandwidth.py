"""Bytes of a step compared with the measured bandwidth of the machine's memory."""

from __future__ import annotations

from softlab.bench.store.machine_records import DISTURBED
from softlab.bench.store.results import Timing
from softlab.plots.core.data import Source

UNKNOWN_CACHE = 1 << 26  # B


def copy_bandwidth(source: Source, backend: str) -> float | None:
    """Return the measured copy bandwidth of a backend's memory [B/s]; None where it was not measured."""
    return source.machine.record.get("gpu_copy_bandwidth" if backend == "gpu" else "copy_bandwidth")


def disturbed(source: Source) -> bool:
    """True if other programs ran while the bandwidth was measured."""
    return bool(source.machine.record.get(DISTURBED))


def fraction(source: Source, timing: Timing) -> float | None:
    """Return the bytes of one fused pass over the time of a step, over the copy bandwidth; None where one is unknown."""
    bandwidth = copy_bandwidth(source, timing.backend)
    if not bandwidth or not timing.bytes_per_step:
        return None
    return timing.bytes_per_step / timing.median / bandwidth


def from_memory(source: Source, timing: Timing) -> bool:
    """True if both buffers of a timing's state exceed the processor's last cache, so that its bytes come from memory.

    Data that stay in a cache use no memory bandwidth. A cache of unknown size counts as 64 MiB.
    """
    caches = source.machine.record.get("caches") or {}
    on_gpu = timing.backend == "gpu"
    last = source.machine.record.get("gpu_l2_bytes") if on_gpu else caches.get("L3") or caches.get("L2")
    return (timing.bytes_per_step or 0) > (last or UNKNOWN_CACHE)
