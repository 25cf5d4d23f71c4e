"""Hard case B1: a hanging chain in which every second link is a million times as stiff.

bench/stress/laws.py defines a law; bench/stress/cases.py has the scenes.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from softlab.bench.stress.laws import disturbed, hanging, ten_times_too_large
from softlab.bench.stress.trial import Check, Trial
from softlab.model.base.errors import UnstableTimeStep
from softlab.model.core.integrators import INTEGRATORS, damping_rate

MAX_STEPS = 250_000  # largest number of steps in which a chain is to settle, a second or two


def too_stiff(trial: Trial) -> list[Check]:
    """B1: refused when opened, with the limit of a chain of stiff springs only, w^2 = 4 k / m.

    (Semi-implicit Euler: 2 / w.) With `allow_unstable` it overflows, which is reported within 200 steps.
    """
    scene = trial.scene
    assert scene.springs is not None
    w = sqrt(4 * scene.springs.largest_stiffness / scene.grid.mass)
    expected = INTEGRATORS[scene.method.integrator].limit(w, damping_rate(scene))
    try:
        trial.open().close()
        named = float("inf")
    except UnstableTimeStep as error:
        named = error.limit
    off = abs(named / expected - 1)
    return [*ten_times_too_large(trial), Check("limit named, from the stiff springs'", off, "", "<", 1e-9)]


def stiff_chain_hangs(trial: Trial) -> list[Check]:
    """B1: below its limit it comes to hang where every link carries the weight below it, to 1 % of its stretch.

    Stiff pairs on soft links vibrate slowest at w = 2 sqrt(k / 2m) sin(pi / 42) = 3.3 1/s, faster than their damper's
    rate gamma / 2. Every mode therefore decays at that rate: to exp(-6) of a stretch within 12 / gamma (`lab`, of
    doubled masses: twice that). An integrator that would need more than MAX_STEPS starts there instead, disturbed, and
    must stay.
    """
    scene = trial.scene
    seconds = 12 / damping_rate(scene) * (2 if trial.is_lab else 1)
    expected = hanging(scene)
    start = trial.rest()
    if trial.steps(seconds) > MAX_STEPS:
        seconds, start = MAX_STEPS * trial.dt, disturbed(trial, expected)
    state = trial.run(trial.start(start), seconds)
    stretch = float(np.abs(expected - trial.rest()).max())
    error = float(np.abs(state.position - expected.reshape(-1, 2)).max())
    return [
        Check("distance from the hanging chain over its stretch", error / stretch, "", "<", 0.01),
        Check("simulated", seconds, "s"),
    ]
