"""Joules of stepping, from the counters that some machines have: NVML's of a GPU, RAPL's of processor packages (Linux).

A counter holds what the whole device took since it was started, idle parts included. It moves in jumps (NVML's every 20
to 100 ms), so a sample of 20 ms tells nothing: steps are run for about half a second, and only what lies between the
first and the last jump counts. No counter, no joules, and no error: most processors hide theirs from users.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.measure.timing import Subject

Counter = Callable[[], float]  # joules since some beginning

STAGE = "energy"  # of the samples that hold joules
LOOP_SECONDS = 0.5  # s
MAX_SECONDS = 0.6  # s: the end of waiting for one more jump
BATCH_SECONDS = 0.01  # s of steps between two looks at the counter: the error of an interval's ends
SLOWEST_STEP = 0.1  # s: with longer ones the loop would hold too few
RAPL = Path("/sys/class/powercap")


@dataclass(frozen=True)
class Energy:
    """`steps` steps took `joules` [J] in `seconds` [s]."""

    joules: float
    seconds: float
    steps: int


def energy_counter(backend: str) -> Counter | None:
    """The counter of the device that a backend runs on, or None where it cannot be read."""
    return nvml_counter() if backend == "gpu" else rapl_counter()


def nvml_counter() -> Counter | None:
    """The total-energy counter of the GPU in use; None without nvidia-ml-py, or where the GPU has none."""
    try:
        import pynvml

        pynvml.nvmlInit()
        handle = _nvml_handle(pynvml)
        pynvml.nvmlDeviceGetTotalEnergyConsumption(handle)
    except Exception:  # the library is optional, and fails in as many ways as drivers do
        return None
    return lambda: 1e-3 * pynvml.nvmlDeviceGetTotalEnergyConsumption(handle)


def _nvml_handle(pynvml: Any) -> Any:
    """NVML's handle of the device that numba uses: the only one, or the one of its name."""
    if pynvml.nvmlDeviceGetCount() == 1:
        return pynvml.nvmlDeviceGetHandleByIndex(0)
    from numba import cuda

    return pynvml.nvmlDeviceGetHandleByUUID(cuda.get_current_device().uuid)


def rapl_counter(folder: Path = RAPL) -> Counter | None:
    """The sum over the processor packages; None where the system has no such counter or lets only root read it."""
    packages = []
    try:
        for package in sorted(folder.glob("intel-rapl:*")):
            if package.name.count(":") == 1:  # intel-rapl:0:0 is a part of intel-rapl:0
                most = int((package / "max_energy_range_uj").read_text())
                packages.append((package / "energy_uj", most))
                int((package / "energy_uj").read_text())
    except (OSError, ValueError):
        return None
    if not packages:
        return None
    seen = [int(file.read_text()) for file, _ in packages]
    total = 0.0

    def joules() -> float:
        nonlocal total
        for k, (file, most) in enumerate(packages):
            now = int(file.read_text())
            total += 1e-6 * ((now - seen[k]) % (most + 1))  # the counter starts again at its end
            seen[k] = now
        return total

    return joules


def measure_energy(subject: Subject, counter: Counter, seconds: float = LOOP_SECONDS) -> Energy | None:
    """Step for about `seconds` [s] and hold the steps against the counter; None where it did not move twice.

    Needs `warm_up` (of bench/measure/timing.py). Raises Diverged.
    """
    if subject.seconds_per_step > SLOWEST_STEP:
        return None
    batch = max(1, round(BATCH_SECONDS / max(subject.seconds_per_step, 1e-9)))
    subject.restore()
    begin, steps, before = time.perf_counter(), 0, counter()
    jumps: list[tuple[float, int, float]] = []  # clock, steps done, joules: of the first jump and of the last
    while True:
        subject.run(batch)
        steps += batch
        clock, joules = time.perf_counter(), counter()
        if joules != before:
            jumps = [*jumps[:1], (clock, steps, joules)]
            before = joules
        passed = clock - begin
        if passed >= seconds * MAX_SECONDS / LOOP_SECONDS or (passed >= seconds and jumps and jumps[-1][1] == steps):
            break
    if len(jumps) < 2:
        return None
    (start, first, low), (end, last, high) = jumps
    return Energy(high - low, end - start, last - first)
