"""Forces are minus the gradient of the reported energy, energy does not come from nothing, and damping takes it from
deformation alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from lab import GRAVITY, Lab, angular_momentum, farthest, in_space, kinetic, masses, start, stirred
from law import limit_of, of
from rows import Row
from test_law_fall import fallen

from softlab.model.core.energy import energies
from softlab.model.core.families import family_of
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

TINY = 2.0**-17  # s: a step in which forces hardly change
FASTEST = (
    2.0**10
)  # 1/s: no vibration of a row is faster, sqrt(8 * 64 N/m / 0.125 kg) = 64 of springs, 4 of tetrahedra / edge
AWAY = 2.0**-12  # m: of a central difference


def slope(scene: Scene, position: np.ndarray) -> np.ndarray:
    """(particles, dimensions) [N]: -grad of the reported energy, by central differences."""
    stored, result = family_of(scene).stored, np.empty_like(position)
    for place in np.ndindex(*position.shape):
        aside = [position.copy(), position.copy()]
        aside[0][place] -= AWAY
        aside[1][place] += AWAY
        result[place] = (stored(scene, aside[0], {})[0] - stored(scene, aside[1], {})[0]) / (2 * AWAY)
    return result


@of("force")
def test_the_force_is_minus_the_gradient_of_the_reported_energy(row: Row, case: str, lab: Lab) -> None:
    """From rest, a step of h gives the velocity h F/m, to (h w)^2 of the fastest vibration w, 6e-5 here; F/m comes
    from v/h with an error of unit * x / h^2 where velocities are differences of positions, below 1e-5 of the largest
    force. The energy's central differences are off by (AWAY / length)^2 / 6 of its third derivative, 1e-6. Together
    1e-4 of the largest force."""
    short = {"dt": TINY} | ({"substeps": 1} if "substeps" in row.tables["method"] else {})
    scene = row.scene(method=short)
    begin = stirred(row, scene, speed=0.0)
    with lab.open(scene, begin) as simulation:
        simulation.advance(1)
        velocity = np.asarray(simulation.state().velocity, np.float64)
    inertia = 2 if row.fall == "half" else 1  # the hand-out's step moves as masses twice as heavy
    force = inertia * masses(begin) * velocity / TINY
    expected = slope(scene, begin.position)
    assert farthest(expected) > 0
    limit = limit_of("force", row)
    assert farthest(force - expected) <= (1e-4 + (limit.part if limit else 0.0)) * farthest(expected)


STEPS = 8


def wobble(row: Row) -> float:
    """How much the reported energy of a scheme may rise above its start, of it, by its own law (docs/method/index.md,
    model/core/ integrators.py); w the fastest vibration of the sheet, from its bound. Semi-implicit Euler (and the
    hand-out's step, with masses twice as heavy) keeps E - h/2 v.grad U, within (1 -+ h w/2) E; velocity Verlet keeps
    kinetic + (1 - (h w/2)^2) potential; the amplification of explicit Euler is 1 + (h w)^2 a step, and that of
    `taylor` 1 + (h w)^2/4 + ..., at most the same."""
    from softlab.model.core.integrators import frequency_bound

    if row.solver != "mass-spring":
        return 0.0
    w = row.h * frequency_bound(row.bare)
    name = row.bare.method.integrator
    w = w / 2**0.5 if name == "lab" else w
    if name in ("lab", "semi-implicit-euler"):
        return (1 + w / 2) / (1 - w / 2) - 1
    if name == "velocity-verlet":
        return 1 / (1 - w * w / 4) - 1
    return (1 + w * w) ** STEPS - 1 if name in ("explicit-euler", "taylor") else 0.0


def total(scene: Scene, state: State) -> float:
    """[J]: what the scheme itself keeps."""
    return energies(scene, state.position, state.velocity, state.arrays, state.inverse_mass)["conserved"]


@of("energy")
def test_energy_never_exceeds_its_start(row: Row, case: str, lab: Lab) -> None:
    """A free body without weight that was stretched and thrown has no source: E(t) <= E(0), but for what rounding
    adds (noise to each velocity), and a bounded wobble of those integrators that keep another energy, or a growth
    that their amplification gives (`wobble`). A fluid starts on its lattice and is thrown at itself: what it stores
    is not reported, so that its kinetic energy may come back, and no more. A rigid body is thrown and turns: out of
    shape, which it would undo at once, it cannot be."""
    scene = row.bare
    begin = start(scene, velocity=thrown(scene)) if row.bare.fluids else stirred(row, scene)
    if row.name == "rigid_body":
        begin = start(scene, velocity=spinning(begin, 2.0))
    states = lab.states(scene, STEPS, begin)
    result = [total(scene, state) for state in states]
    n = STEPS * scene.method.substeps
    mass = masses(begin).sum()
    rounding = n * lab.noise(scene, *states) * (2 * mass * result[0]) ** 0.5 * (1 + scene.method.iterations)
    limit = limit_of("energy", row)
    allowed = (wobble(row) + (limit.part if limit else 0.0)) * result[0]
    assert max(result) <= result[0] + rounding + allowed, (result, rounding)


def thrown(scene: Scene) -> np.ndarray:
    """(particles, dimensions) [m/s]: towards the middle, and a turn."""
    begin = start(scene)
    about = begin.position - begin.position.mean(axis=0)
    return -2.0 * about


def spinning(begin: State, omega: float) -> np.ndarray:
    """(particles, dimensions) [m/s]: of a rigid turn about the centre, in the plane z."""
    weight = masses(begin)
    about = begin.position - (weight * begin.position).sum(axis=0) / weight.sum()
    return np.cross([0.0, 0.0, omega], in_space(about))[:, : begin.position.shape[1]]


@of("damping")
def test_a_materials_damping_slows_neither_a_fall_nor_a_turn(row: Row, case: str, lab: Lab) -> None:
    """A damper acts on strain rates. A fall has none: y is the closed form, to rounding. A turn has one only while
    the body stretches by s = w^2 / w0^2 to bear its own centrifugal force, w0 its slowest vibration; what a damper
    may change of the angular momentum is of second order in the strain and its rates, below a thousandth of it in a
    25th of a turn here; without a damper the scheme's own loss is the same."""
    if case == "fall":
        scene = row.scene(row.damper or {}, gravity={"acceleration": GRAVITY})
        begin = start(scene)
        state = lab.run(scene, STEPS, begin)
        n, time = STEPS * scene.method.substeps, STEPS * scene.method.dt
        moved = np.asarray(state.position, np.float64) - begin.position
        moved[:, 1] += fallen(row, STEPS)
        assert farthest(moved) <= n * (1 + scene.method.iterations) * lab.noise(scene, begin, state) * time
        return
    result: list[Any] = []
    for scene in (row.bare, row.scene(row.damper or {})):
        begin = start(scene, velocity=spinning(start(scene), 4.0))
        state = lab.run(scene, STEPS, begin)
        result.append((farthest(angular_momentum(state) - angular_momentum(begin)), angular_momentum(state)))
    scale = farthest(angular_momentum(begin))
    rounding = STEPS * scene.method.substeps * lab.noise(scene, state) * masses(begin).sum()
    assert farthest(result[0][1] - result[1][1]) <= 1e-3 * scale + rounding, (result, scale)
    assert kinetic(state) > 0
