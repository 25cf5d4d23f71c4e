"""Hard cases B13 to B15: a chain of thousands of links, one far from the origin, and denormal numbers.

bench/stress/laws.py defines a law; bench/stress/cases.py has the scenes. B14: the published bound is ten ulp, which
holds for a chain released along gravity; one that swings 100 km away was measured at 14 with rk4, so its bound is 20.
The hand-out's step satisfies neither, in float64 either.
"""

from __future__ import annotations

import statistics
import time

import numpy as np

from softlab.bench.reference import mass_spring as reference
from softlab.bench.stress.laws import Law
from softlab.bench.stress.trial import Check, Trial

SLOW_DOWN = 1.5  # times: largest slow-down by denormal numbers


def long_chain(trial: Trial) -> list[Check]:
    """B13: 4096 links released. For 10 s the bottom mass is not reached by the pin's wave (32 links/s).

    It falls like a single mass: the reference's. float32: an ulp of its depth per step.
    """
    state = trial.run(trial.start(trial.rest()), 10.0)
    alone = trial.scene.replace({"grid.rows": 1, "grid.pinned": "none"})
    fall = reference.simulate(alone, state.step)[0][0, 1]
    expected = trial.rest()[-1, 0, 1] + fall
    ulp = float(np.spacing(np.float32(expected) if trial.single else np.float64(expected)))
    error = abs(float(state.position[-1, 1]) - expected)
    return [
        Check("bottom mass from free fall", error, "m", "<", abs(ulp) * state.step),
        Check("lowest point", float(state.position[:, 1].min()), "m"),
    ]


def far_away(offset: float, swinging: bool) -> Law:
    """B14: a ten-link chain released `offset` [m] from the origin, for 1 s, against itself at the origin in float64.

    In ulp of the offset: along gravity (published bound: 10), or sideways, to swing (bound: 20).
    """

    def law(trial: Trial) -> list[Check]:
        position = trial.rest()
        if swinging:
            position = position[..., ::-1] * (-1, 1)
        away = np.array([0.0, offset])
        exact = reference.simulate(trial.scene, trial.steps(1.0), position.reshape(-1, 2), None)[0]
        state = trial.run(trial.start(position + away), 1.0)
        ulp = np.spacing(np.float32(offset) if trial.single else np.float64(offset))
        error = float(np.abs(state.position.astype(np.float64) - away - exact).max() / ulp)
        return [Check("distance from the run at the origin", error, "ulp", "<", 20.0 if swinging else 10.0)]

    return law


def denormals(trial: Trial) -> list[Check]:
    """B15: stretches and velocities below the smallest normal number.

    No NaN appears (the squared length underflows, 1/r is guarded), and nothing grows from them. The ratio of the step
    time to that with ordinary numbers should be at most 1.5; it is reported but not part of the verdict, which would
    change from run to run if it depended on a time.
    """
    tiny = 1e-40 if trial.single else 1e-310
    random = np.random.default_rng(3).standard_normal(trial.rest().shape)
    random[0] = 0
    small, ordinary = trial.start(tiny * random, tiny * random), trial.start(random, random)
    times: dict[str, list[float]] = {"small": [], "ordinary": []}
    with trial.open(small) as simulation:
        trial.advance(simulation, 100)
        state = trial.checked_state(simulation)
        for _ in range(9 if trial.timed else 0):
            for name, initial in (("small", small), ("ordinary", ordinary)):
                simulation.load(initial)
                simulation.synchronize()
                begin = time.perf_counter()
                simulation.advance(100)
                simulation.synchronize()
                times[name].append(time.perf_counter() - begin)
    largest = float(np.abs(state.position).max())
    checks = [Check("largest coordinate over its start", largest / tiny, "", "<", 100.0)]
    if trial.timed:
        ratio = statistics.median(a / b for a, b in zip(times["small"], times["ordinary"], strict=True))
        checks.append(Check("time over that of ordinary numbers", ratio, "", "aim <=", SLOW_DOWN))
    return checks
