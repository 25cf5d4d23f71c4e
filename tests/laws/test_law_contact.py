"""Friction within Coulomb's cone, and restitution."""

from __future__ import annotations

from math import cos, radians, sin

import numpy as np
from lab import GRAVITY, Lab, masses, mean_velocity, start
from law import limit_of, of
from rows import Row
from test_law_rest import THICKNESS, lying, sag

from softlab.model.core.build import build

STEPS = 8
MU = 0.25
SPEED = 1.0  # m/s


@of("friction")
def test_friction_stays_in_coulombs_cone(row: Row, case: str, lab: Lab) -> None:
    """Slides: thrown along a floor at 1 m/s, a body loses |p_t| = mu p_n of its momentum, p_n = M (g t + dv_y) what
    the floor gave it across; after 8 steps of 1/128 s it still goes at 0.87 m/s. The floor acts substep by substep,
    so that it lacks or has too much of one at most: mu g h. Its lower half is slowed first, which changes nothing in
    the sum.

    Sticks: on a slope of 10 degrees with mu 0.25 > tan 10 = 0.176, where friction acts on velocities alone, a body
    creeps by what gravity adds in a substep, g h sin a (docs/method/grids.md, contact), while p_t <= mu p_n."""
    h, pull = row.h, GRAVITY / (2 if row.fall == "half" else 1)  # of which the hand-out's step integrates half
    n, time = STEPS * row.bare.method.substeps, STEPS * row.bare.method.dt
    if case == "slides":
        scene = lying(row, "plane", {"static_friction": MU, "dynamic_friction": MU})
        begin = start(scene, velocity=[SPEED, 0.0, 0.0])
        state = lab.run(scene, STEPS, begin)
        lost = SPEED - mean_velocity(state)[0]
        across = pull * time + mean_velocity(state)[1]
        rounding = n * (1 + scene.method.iterations) * lab.noise(scene, begin, state)
        limit = limit_of("friction", row)
        assert lost <= MU * across + MU * pull * h + rounding, (lost, MU * across)
        assert lost >= MU * across - MU * pull * h - rounding - (limit.part if limit else 0.0), (lost, MU * across)
        return
    tilt = radians(10)
    place = build(row.scene(row.lain)).position
    normal = np.array([sin(tilt), cos(tilt), 0.0])
    low = (place @ normal).min()
    turned = turn_onto(place, tilt) if np.ptp(place[:, 1]) == 0 else place
    if turned is not place:
        low = (turned @ normal).min()
    point = normal * (low - THICKNESS)
    floor = {
        "kind": "plane", "thickness": THICKNESS, "point": point.tolist(), "normal": normal.tolist(),
        "static_friction": MU, "dynamic_friction": MU,
    }  # fmt: skip
    scene = row.scene(row.lain, gravity={"acceleration": GRAVITY}, floor=floor)
    begin = start(scene, position=turned)
    state = lab.run(scene, STEPS, begin)
    down = np.array([cos(tilt), -sin(tilt), 0.0])
    speed = float(mean_velocity(state) @ down)
    rounding = n * (1 + scene.method.iterations) * lab.noise(scene, begin, state)
    across = pull * cos(tilt) * time + float(mean_velocity(state) @ normal)
    along = pull * sin(tilt) * time - speed
    assert along <= MU * across + MU * pull * h + rounding, "more friction than the cone allows"
    if turned is not place:
        assert speed <= pull * h * sin(tilt) + rounding, speed


def turn_onto(place: np.ndarray, tilt: float) -> np.ndarray:
    """A flat body, laid onto the slope."""
    middle = place.mean(axis=0)
    about = place - middle
    result = about.copy()
    result[:, 0] = cos(tilt) * about[:, 0] + sin(tilt) * about[:, 1]
    result[:, 1] = -sin(tilt) * about[:, 0] + cos(tilt) * about[:, 1]
    return middle + result


@of("rebound")
def test_restitution(row: Row, case: str, lab: Lab) -> None:
    """A body that lands flat, all of it at once, at 1 m/s on a plane without friction leaves at e of that, so that
    without losses it comes back to e^2 of its height; with e = 0 it stays. There is no gravity, so that the speed
    below which it would rest, 2 g h, is none. Landing flat strains nothing: each particle gets the same, to rounding,
    and a body of clusters projects what rounding leaves, `iterations` times."""
    restitution = float(case)
    flat = row.scene(row.lain)
    low = float(build(flat).position[:, 1].min())
    floor = {"kind": "plane", "thickness": THICKNESS, "point": [0.0, low - THICKNESS - 2.0**-5, 0.0]}
    scene = row.scene(row.lain, floor=floor | ({"restitution": restitution} if restitution else {}))
    begin = start(scene, velocity=[0.0, -SPEED, 0.0])
    state = lab.run(scene, STEPS, begin)
    n = STEPS * scene.method.substeps
    expected = np.array([0.0, restitution * SPEED, 0.0])
    error = np.abs(np.asarray(state.velocity, np.float64) - expected).max()
    assert error <= n * (1 + scene.method.iterations) * lab.noise(scene, begin, state), (error, state.velocity[0])
    assert sag(row) == 0 or masses(state).sum() > 0
