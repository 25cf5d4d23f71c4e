"""Linear and angular momentum of a free body."""

from __future__ import annotations

from itertools import pairwise
from math import sqrt

import numpy as np
from lab import Lab, angular_momentum, farthest, in_space, masses, momentum, start, stirred
from law import limit_of, of
from rows import Row
from test_law_energy import spinning

from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

STEPS = 6


def one_substep(row: Row) -> Scene:
    """The free body, a substep a step, so that states show each of them."""
    return row.scene(method={"substeps": 1}) if "substeps" in row.tables["method"] else row.bare


@of("momentum")
def test_linear_momentum(row: Row, case: str, lab: Lab) -> None:
    """sum m v stays: internal forces come in pairs. Rounding changes the velocity of each particle by `noise` in each
    of n substeps, for every iteration (model/core/stability/laws.py has the schemes that lose it, each with its own
    bound)."""
    scene = one_substep(row)
    states = lab.states(scene, STEPS, stirred(row, scene))
    limit = limit_of("momentum", row)
    rounding = STEPS * (1 + scene.method.iterations) * lab.noise(scene, *states) * masses(states[0]).sum()
    lost = farthest(momentum(states[-1]) - momentum(states[0]))
    exchanged = sum(pushed(one, other) for one, other in pairwise(states))
    assert lost <= rounding + (limit.part * exchanged if limit else 0.0), (lost, rounding, exchanged)


def pushed(one: State, other: State) -> float:
    """[kg m/s]: sum of m |dv|, the momentum that a step exchanges."""
    change = np.asarray(other.velocity, np.float64) - one.velocity
    return float((masses(one)[:, 0] * np.linalg.norm(change, axis=1)).sum())


def turned_away(one: State, other: State, h: float) -> float:
    """[kg m^2/s]: h * sum m |v| |dv| of a substep, see `test_angular_momentum`."""
    change = np.linalg.norm(np.asarray(other.velocity, np.float64) - one.velocity, axis=1)
    speed = np.maximum(np.linalg.norm(one.velocity, axis=1), np.linalg.norm(other.velocity, axis=1))
    return float(h * (masses(one)[:, 0] * speed * change).sum())


@of("angular momentum")
def test_angular_momentum(row: Row, case: str, lab: Lab) -> None:
    """sum m x cross v stays to rounding where forces act at the positions that they were computed at and velocities
    then carry them on: semi-implicit Euler, velocity Verlet, and the hand-out's step, which is the former.

    Every other scheme ends its substep at x' = x + h v' with forces along lines between x'-like positions: sum m x'
    cross v' = sum m (x + h v') cross v' = sum m x cross v' differs from sum m x cross v by |sum (x - x*) cross m dv|,
    where x* is where the forces act, at most h |v| away. So a substep changes it by h sum m |v| |dv| at most, which
    is of first order in h; of a turning rigid body that is the law omega(t) = omega0 / sqrt(1 + omega0^2 h t)
    (model/formulas/shape_matching/rigid.py). Two stages of order 2 and Runge-Kutta's four lose less.
    Explicit Euler and `taylor` move before they are kicked: the same bound.

    Asked of a stirred body, whose velocities have any direction, and of one that turns as a whole: there m dv points to
    the middle, across v, so that the bound is the loss itself, w^2 h t of the spin."""
    scene = one_substep(row)
    for begin in (stirred(row, scene), start(scene, velocity=spinning(start(scene), 2.0))):
        angular_momentum_stays(row, scene, lab, begin)
    if row.name == "rigid_body":
        spin_of_a_rigid_body(row, lab)


def angular_momentum_stays(row: Row, scene: Scene, lab: Lab, begin: State) -> None:
    """Within the bound of `test_angular_momentum`."""
    states = lab.states(scene, STEPS, begin)
    limit = limit_of("angular momentum", row)
    arm = farthest(states[-1].position) + farthest(states[0].position)
    rounding = STEPS * (1 + scene.method.iterations) * lab.noise(scene, *states) * masses(states[0]).sum() * arm
    lost = farthest(angular_momentum(states[-1]) - angular_momentum(states[0]))
    allowed = sum(turned_away(one, other, scene.method.dt) for one, other in pairwise(states))
    exchanged = arm * sum(pushed(one, other) for one, other in pairwise(states))
    bound = rounding + (allowed + limit.part * exchanged if limit else 0.0)
    assert lost <= bound, (lost, rounding, allowed)


def spin_of_a_rigid_body(row: Row, lab: Lab) -> None:
    """omega(t) = omega0 / sqrt(1 + omega0^2 h t): of the angles of two substeps tan D' = sin D, D' = D - D^3/2 + O(D^5),
    which has that solution to D^5 and, as sums over steps differ from integrals by one step's worth, D^2/2 more:
    2 D^2 = 5e-4 of the spin here, a quarter of what is lost (16 D^2/2)."""
    scene, omega, steps = one_substep(row), 2.0, 16
    begin = start(scene)
    about = begin.position - begin.position.mean(axis=0)
    spin = np.cross([0.0, omega, 0.0], in_space(about))
    state = lab.run(scene, steps, start(scene, velocity=spin))
    h = scene.method.dt
    place, speed = state.position - np.mean(state.position, axis=0), np.asarray(state.velocity)
    inertia = (masses(state)[:, 0] * (place[:, 0] ** 2 + place[:, 2] ** 2)).sum()
    result = (masses(state) * np.cross(place, speed)).sum(axis=0)[1] / inertia
    expected = omega / sqrt(1 + omega**2 * h * h * steps)
    assert abs(result / expected - 1) <= 2 * (omega * h) ** 2 + 100 * lab.noise(scene, state) / omega
