"""Joules of stepping, from the counters that some machines have: NVML's of a GPU, RAPL's of processor packages (Linux).

A counter contains the energy of the whole device since it was started, idle parts included. It moves in jumps (NVML's
every 20 to 100 ms), so a sample of 20 ms is useless. A sample lasts from one jump to another nearly a second later, and
the counter is read only near the jumps, because each reading makes the device wait: in between, steps run as they do
when they are timed. Without a counter there are no joules and no error: most processors hide theirs from users.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from softlab.bench.measure.gpu import nvml
from softlab.bench.measure.timing import Subject

Counter = Callable[[], float]  # joules since some beginning

STAGE = "energy"  # of the samples that hold joules
LOOP_SECONDS = 0.8  # s of steps between two jumps of the counter
MAX_WAIT = 0.25  # s: the end of waiting for a jump
BATCH_SECONDS = 0.005  # s of steps between two looks at the counter: the error of an interval's ends
SLOWEST_STEP = 0.1  # s: with longer ones the loop would hold too few
SLOWER = 1.1  # times as long as when they were timed: such steps are not those whose joules are wanted
RAPL = Path("/sys/class/powercap")


@dataclass(frozen=True)
class Energy:
    """`joules` [J] of `steps` steps in `seconds` [s]."""

    joules: float
    seconds: float
    steps: int

    @property
    def watts(self) -> float:
        return self.joules / self.seconds

    def suspect(self, seconds_per_step: float, limit: float | None) -> str | None:
        """Reason to doubt the sample, or None. `seconds_per_step`: as timed [s]; `limit`: of the device's power [W]."""
        slower = self.seconds / self.steps / seconds_per_step
        reasons = [f"steps took {slower:.2f} times as long as when timed"] if slower > SLOWER else []
        if limit is not None and self.watts > 1.05 * limit:
            reasons.append(f"{self.watts:.0f} W of a device that may take {limit:.0f} W")
        return "; ".join(reasons) or None


def energy_counter(backend: str) -> Counter | None:
    """The counter of the device that a backend runs on, or None where it cannot be read."""
    return nvml_counter() if backend == "gpu" else rapl_counter()


def nvml_counter(number: int | None = None) -> Counter | None:
    """The total-energy counter of the GPU in use, or of device `number`; None without nvidia-ml-py, or where the GPU has
    none."""
    library, handle = nvml(number)
    with suppress(Exception):  # it fails in as many ways as drivers do
        library.nvmlDeviceGetTotalEnergyConsumption(handle)
        return lambda: 1e-3 * library.nvmlDeviceGetTotalEnergyConsumption(handle)
    return None


def power_limit(backend: str) -> float | None:
    """Power limit of the GPU [W]; None for a CPU, or where the driver does not report it."""
    if backend != "gpu":
        return None
    library, handle = nvml()
    with suppress(Exception):  # as in nvml_counter
        return 1e-3 * library.nvmlDeviceGetEnforcedPowerLimit(handle)
    return None


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
    """Step for about `seconds` [s] from a jump of the counter to another; None where it does not jump, or a step takes so
    long that the interval would hold too few.

    Needs `warm_up` (of bench/measure/timing.py). Raises Diverged.
    """
    if subject.seconds_per_step > SLOWEST_STEP:
        return None
    per_step = max(subject.seconds_per_step, 1e-9)
    batch, loop = max(1, round(BATCH_SECONDS / per_step)), max(1, round(seconds / per_step))
    subject.restore()
    first = _jump(subject, counter, batch)
    if first is None:
        return None
    subject.run(loop)
    last = _jump(subject, counter, batch)
    if last is None:
        return None
    return Energy(last.joules - first.joules, last.clock - first.clock, loop + last.steps)


def joules_of_all(subject: Subject, counters: Sequence[Counter | None]) -> float | None:
    """Energy of a step on all devices together [J], each measured by itself, since counters do not jump together; None
    where one of them has no counter. Raises Diverged."""
    total = 0.0
    for counter in counters:
        interval = counter and measure_energy(subject, counter)
        if not interval:
            return None
        total += interval.joules / interval.steps
    return total


@dataclass(frozen=True)
class _Jump:
    """A jump of the counter: its time (`clock` [s]), the new value (`joules`), and the number of steps until then."""

    clock: float
    joules: float
    steps: int


def _jump(subject: Subject, counter: Counter, batch: int) -> _Jump | None:
    """Step until the counter moves; None where it does not within MAX_WAIT."""
    before, steps, begin = counter(), 0, time.perf_counter()
    while time.perf_counter() - begin < MAX_WAIT:
        subject.run(batch)
        steps += batch
        joules = counter()
        if joules != before:
            return _Jump(time.perf_counter(), joules, steps)
    return None
