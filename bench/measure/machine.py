"""Description of this machine: the facts needed to read a time, its measured limits, a key and a label.

The record names no host and no user. Bandwidths count bytes read plus bytes written; both are measured well beyond the
caches, on all cores. Facts are had in milliseconds, the measured limits in about two seconds.
"""

from __future__ import annotations

import hashlib
import platform
import re
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from softlab.bench.measure.gpu import gpu_facts, gpu_or_reason, gpu_simulated
from softlab.bench.measure.timing import Neighbours
from softlab.bench.store.database import Store
from softlab.bench.store.schema import canonical
from softlab.cpu_backend.core.threads import MULTIPLES, core_count, threading_layer, wait_policy
from softlab.model.base.memory import available_bytes

PACKAGES = ("numba", "llvmlite", "numpy", "numba-cuda")
IDENTITY = (  # what tells two machines apart: hardware, and the versions that compile the kernels
    "cpu", "cores", "caches", "memory_gib", "system", "architecture", "python", "numba", "llvmlite", "numba_cuda",
    "gpu", "gpu_count", "gpu_memory_gib", "gpu_driver",
)  # fmt: skip
MIN_COPY_BYTES = 1 << 28  # of one array


def machine_record() -> dict[str, object]:
    """Return the facts of this machine without measurements: cpu, cores, caches [B], memory, versions, gpu ...; None if
    unknown or absent."""
    from softlab.cpu_backend.core.processor import processor_name

    record: dict[str, object] = {
        "cpu": processor_name(),
        "cores": core_count(),
        "caches": _caches(),
        "memory_gib": _memory_gib(),
        "system": platform.system(),
        "system_release": platform.release(),
        "architecture": platform.machine(),
        "python": ".".join(platform.python_version_tuple()[:2]),
        "python_build": f"{platform.python_implementation()} {platform.python_version()}",
        "threading_layer": threading_layer(),
        "wait_policy": wait_policy(),
        "numba_threads": _numba_threads(),
    }
    for package in PACKAGES:
        try:
            record[package.replace("-", "_")] = metadata.version(package)
        except metadata.PackageNotFoundError:
            record[package.replace("-", "_")] = None
    return record | gpu_facts()


def machine_key(record: Mapping[str, object]) -> str:
    """Return 12 hexadecimal digits that identify the machine: the same in every process, without its name."""
    identity = {name: record.get(name) for name in IDENTITY}
    return hashlib.sha256(canonical(identity).encode()).hexdigest()[:12]


def machine_label(record: Mapping[str, Any]) -> str:
    """Return the machine's name for captions: `AMD EPYC 7B12, 2 cores; no GPU`."""
    cpu = re.sub(r"\((R|TM|r|tm)\)| CPU| Processor|@.*$|\d+-Core", "", record["cpu"])
    cores = f"{record['cores']} core" + ("s" if record["cores"] != 1 else "")
    gpu = record.get("gpu") or "no GPU"
    if record.get("gpu_count") or 0:
        gpu = f"{record['gpu_count']} x {gpu}" if record["gpu_count"] > 1 else gpu
    return f"{' '.join(cpu.split())}, {cores}; {gpu}"


def enter_machine(store: Store) -> str:
    """Enter this machine into the store, with measured limits where they are missing, and return its key."""
    import json

    record = machine_record()
    key = machine_key(record)
    known = store.query("SELECT record FROM machine WHERE key = ?", (key,))
    stored = json.loads(known[0][0]) if known else {}
    if stored.get("copy_bandwidth") is None or (record["gpu"] and stored.get("gpu_copy_bandwidth") is None):
        record |= measured_limits()
    store.add_machine(key, machine_label(record), record)
    return key


def measured_limits() -> dict[str, object]:
    """Measure copy_bandwidth and gpu_copy_bandwidth [B/s], region_seconds {threads: s}, gpu_launch_seconds;
    limits_suspect: the reason not to trust them.

    None where it cannot be measured, or is not the case.
    """
    size, neighbours = copy_bytes(), Neighbours()
    bandwidth = None
    with suppress(MemoryError):  # of a machine that has none left, a limit is not known, and all else is
        bandwidth = copy_bandwidth(size)
    limits: dict[str, object] = {
        "copy_bandwidth": bandwidth,
        "copy_bytes": 2 * size,
        "region_seconds": region_costs(),
        "limits_suspect": neighbours.suspicion(core_count()),
    }
    return limits | _gpu_limits()


# ---------------------------------------------------------------------- the processor


def _best(run: Callable[[], None], budget: float) -> float:
    """Return the minimum time [s] of `run`, repeated at least three times and for `budget` seconds, because a limit is
    a best case."""
    best, end, count = float("inf"), time.perf_counter() + budget, 0
    while count < 3 or time.perf_counter() < end:
        begin = time.perf_counter()
        run()
        best, count = min(best, time.perf_counter() - begin), count + 1
    return best


@cache
def _copy_kernel() -> Callable[..., None]:
    from numba import prange

    from softlab.cpu_backend.core.compile import Compiler

    def copy(source, target, bands):
        width = source.size // bands
        for band in prange(bands):
            begin = np.int64(band) * width
            read, write = source[begin : begin + width], target[begin : begin + width]
            for k in range(width):  # counted from 0: an index that might be negative is not vectorised
                write[k] = read[k]

    return Compiler("float32", "exact").kernel(copy)


@cache
def _region_kernel() -> Callable[..., None]:
    from numba import prange

    from softlab.cpu_backend.core.compile import Compiler

    def regions(repeats, out):
        for _ in range(repeats):
            for k in prange(out.size):
                out[k] += 1

    return Compiler("int64", "exact").kernel(regions)


def copy_bytes() -> int:
    """Bytes of one array to copy: four times the largest cache (servers have 300 MiB and more), as memory allows."""
    wanted = max(MIN_COPY_BYTES, 4 * max((_caches() or {"": 0}).values()))
    return min(wanted, available_bytes() // 8) // 4096 * 4096


def copy_bandwidth(size: int) -> float:
    """Bytes a second, read and written, of copying between two arrays of `size` bytes, on all cores."""
    import numba

    numba.set_num_threads(min(core_count(), _numba_threads()))
    source, target = np.ones(size // 4, np.float32), np.zeros(size // 4, np.float32)
    kernel, bands = _copy_kernel(), core_count()
    copied = 8 * (size // 4 // bands * bands)
    kernel(source, target, bands)
    return copied / _best(lambda: kernel(source, target, bands), 0.3)


def region_seconds(threads: int) -> float:
    """Seconds that one parallel region costs by itself (start, barrier), on `threads` threads."""
    import numba

    numba.set_num_threads(threads)
    kernel, out = _region_kernel(), np.zeros(threads, np.int64)
    kernel(1, out)
    return _best(lambda: kernel(50, out), 0.05) / 50


def region_costs() -> dict[str, float]:
    """{threads: region_seconds} for one thread and for 1x, 2x, 4x the cores; keys as JSON has them."""
    return {str(count): region_seconds(count) for count in _thread_counts()}


def _thread_counts() -> list[int]:
    counts = {1, *(factor * core_count() for factor in MULTIPLES.values())}
    return sorted(count for count in counts if count <= _numba_threads())


def _numba_threads() -> int:
    import numba

    return int(vars(numba.config)["NUMBA_NUM_THREADS"])  # set at run time, from the environment


def _caches() -> dict[str, int] | None:
    """Bytes of the caches that the first core sees (`L1d`, `L2`, `L3`), where the system reports them."""
    sizes: dict[str, int] = {}
    for folder in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        try:
            kind, level = (folder / "type").read_text().strip(), (folder / "level").read_text().strip()
            size = (folder / "size").read_text().strip()
            if kind != "Instruction":
                sizes[f"L{level}" + ("d" if kind == "Data" else "")] = int(size.rstrip("KM")) * (
                    1 << (20 if size.endswith("M") else 10)
                )
        except (OSError, ValueError):
            continue
    return sizes or None


def _memory_gib() -> int:
    """Main memory, in whole GiB, so that it does not change from boot to boot."""
    return round(psutil.virtual_memory().total / 2**30)


# ---------------------------------------------------------------------- the GPU


def _gpu_limits() -> dict[str, object]:
    limits: dict[str, object] = {"gpu_copy_bandwidth": None, "gpu_launch_seconds": None}
    if not gpu_or_reason()[0] or gpu_simulated():
        return limits
    from numba import cuda

    size = int(min(1 << 30, cuda.current_context().get_memory_info()[0] // 8))
    source, target = cuda.device_array(size // 4, np.float32), cuda.device_array(size // 4, np.float32)

    def copies() -> None:
        for _ in range(8):
            target.copy_to_device(source)
        cuda.synchronize()

    limits["gpu_copy_bandwidth"] = 8 * 2 * size / _best(copies, 0.3)

    @cuda.jit
    def nothing():
        pass

    def launches() -> None:
        for _ in range(100):
            nothing[1, 32]()
        cuda.synchronize()

    launches()
    limits["gpu_launch_seconds"] = _best(launches, 0.1) / 100
    return limits


if __name__ == "__main__":
    facts = machine_record() | measured_limits()
    sys.stdout.write(f"{machine_key(facts)}  {machine_label(facts)}\n{facts}\n")
