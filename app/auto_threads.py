"""`--threads auto`: one thread per core or one thread, whichever takes less time per step on this machine now.

Threads that wait for each other lose where other programs use the cores, and small scenes gain nothing from them. Both
variants are opened and sampled in turn, and the slower one is closed.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence

from softlab.model.base.errors import Diverged
from softlab.model.core.simulation import Simulation

AUTO = "auto"
GAIN = 1.1  # more threads must be that much quicker: they keep cores from others
SECONDS, MAX_STEPS = 0.03, 1000  # s, the least of a sample; steps, the most
ROUNDS = 3


def decide(seconds: Mapping[int, float]) -> tuple[int, str]:
    """Return (threads, reason) from the seconds per step by thread count: the fewest threads within GAIN of the
    fastest."""
    quickest = min(seconds.values())
    chosen = min(count for count, taken in seconds.items() if taken <= GAIN * quickest)
    timings = ", ".join(f"{1e3 * taken:.3g} ms a step on {count}" for count, taken in sorted(seconds.items()))
    return chosen, f"{AUTO}: {timings}"


def step_seconds(simulations: Sequence[Simulation], clock: Callable[[], float] = time.perf_counter) -> list[float]:
    """Return the median seconds per step of each simulation, sampled in turn after a reset. Raises Diverged."""

    def sample(simulation: Simulation, steps: int) -> float:
        simulation.reset()
        begin = clock()
        simulation.advance(steps)
        simulation.synchronize()
        return (clock() - begin) / steps

    for simulation in simulations:
        sample(simulation, 1)  # compiles
    slowest = max(sample(simulation, 1) for simulation in simulations)
    steps = max(1, min(MAX_STEPS, math.ceil(SECONDS / slowest))) if slowest > 0 else MAX_STEPS
    taken = [[sample(simulation, steps) for simulation in simulations] for _ in range(ROUNDS)]
    return [statistics.median(column) for column in zip(*taken, strict=True)]


def open_quickest(
    open_with: Callable[[int], Simulation],
    most: int,
    measure: Callable[[Sequence[Simulation]], list[float]] = step_seconds,
) -> Simulation:
    """Return the simulation on `most` threads or on one, whichever is faster, reset; `threads_reason` says why."""
    if most == 1:
        only = open_with(1)
        only.threads_reason = f"{AUTO}: one core"
        return only
    opened: list[Simulation] = []
    try:
        opened += [open_with(most)]
        opened += [open_with(1)]
        try:
            chosen, reason = decide(dict(zip((most, 1), measure(opened), strict=True)))
        except Diverged:
            chosen, reason = most, f"{AUTO}: the scene diverged before the threads were measured"
        taken = opened.pop(0 if chosen == most else 1)
        taken.threads_reason = reason
        taken.reset()
        return taken
    finally:
        for other in opened:
            other.close()
