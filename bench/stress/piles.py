"""Hard cases of bodies under load and at rest: stacks, a heavy body on a light one, heaps, and dropped bodies.

bench/stress/trial.py defines the result of a law; bench/stress/body_cases.py has the scenes.
"""

from __future__ import annotations

import numpy as np

from softlab.bench.experiments.body_scenes import (
    BRICK_HEIGHT,
    GRAVITY,
    ULP,
    kinetic,
    masses,
    nearest,
    out_of_shape,
    sunk,
)
from softlab.bench.stress.bodies import LAG
from softlab.bench.stress.trial import Check, Trial
from softlab.model.core.simulation import State

SECONDS = 10.0
NEAR = 0.02  # of g h^2: how far a stack may be from its settled state
STILL = 1e-6  # fraction of the energy of a drop
SINKING, LOWERED, BORNE, DEPTH, RATIO = (  # names of the numbers that the lab book quotes
    "sinking of an interface, off 4 k g h^2, over g h^2", "way of the top over a brick's height",
    "depth over 2 (1 + r) g h^2, off 1", "depth over the distance of particles", "r",
)  # fmt: skip
STILL_FRACTION, GAP_FRACTION = 1e-3, 0.8  # B18: of the largest kinetic energy, and of the contact distance


def of_rounding(trial: Trial, size: float) -> float:
    """Rounding error of a depth, over g h^2: the next substep reverts four roundings of `size` [m]."""
    h = trial.dt / trial.scene.method.substeps
    return 8 * ULP[trial.precision] * size / (GRAVITY * h * h)


def stands(trial: Trial) -> list[Check]:
    """B18: a stack of bricks at rest for 10 s.

    A projection of a contact of depth d moves two particles by d / 2 each, so C of them give C m d / 2 of mass times
    displacement. In a substep k bricks of n particles need k n m g h^2: d = 2 k (n / C) g h^2, i.e. 4 k g h^2 for
    bricks of two layers. The plane only moves the lower particles, 2 N g h^2, and the brick's mean lies higher by g h^2
    and half of it: (2 N - 1) g h^2. Nothing leans, and nothing moves.
    """
    scene, state = trial.scene, trial.run(None, SECONDS)
    bricks = len(scene.body_set.copies)
    expected = np.array([2 * bricks - 1, *(4 * above for above in range(bricks - 1, 0, -1))])
    at = state.position.astype(np.float64)
    sinking = sunk(scene, at)
    height = bricks * BRICK_HEIGHT
    return [
        Check(SINKING, float(np.abs(sinking - expected).max()), "", "<",
              NEAR + of_rounding(trial, height)),
        Check(LOWERED, float(_lowered(trial, at, bricks - 1)) / BRICK_HEIGHT, ""),
        *_quiet(trial, state, height),
    ]  # fmt: skip


def bears(trial: Trial) -> list[Check]:
    """B18: penetration under load: the upper brick has a mass of r m per particle, the lower one m.

    A contact of depth d moves masses by d / (w + W), w = 1 / m, W = 1 / (r m). C of them carry n r m g h^2, so that d =
    (n / C) (1 + r) g h^2, i.e. 2 (1 + r) g h^2 for bricks of two layers. The rounding errors of the lower one are those
    of a load of 1 + r bricks.
    """
    scene, state = trial.scene, trial.run(None, SECONDS)
    m = masses(scene)[:, 0]
    ratio = float(m[scene.body_set.body == 1][0] / m[scene.body_set.body == 0][0])
    at = state.position.astype(np.float64)
    sinking, h = sunk(scene, at)[1], trial.dt / scene.method.substeps
    rounded = of_rounding(trial, 2 * BRICK_HEIGHT) * (1 + ratio)
    return [
        Check(BORNE, abs(sinking / (2 * (1 + ratio)) - 1), "", "<",
              NEAR + rounded / (2 * (1 + ratio))),
        Check(DEPTH, sinking * GRAVITY * h * h / scene.body_set.spacing, ""),
        Check(RATIO, ratio, ""),
        *_quiet(trial, state, 2 * BRICK_HEIGHT, 1 + ratio),
    ]  # fmt: skip


def heaps_up(trial: Trial) -> list[Check]:
    """B18: bodies dropped on each other do not penetrate, recover their shapes, and are nearly still after 10 s."""
    scene, peak = trial.scene, 0.0
    with trial.open() as simulation:
        for _ in range(100):
            trial.advance(simulation, trial.steps(SECONDS / 100))
            state = trial.checked_state(simulation)
            energy = kinetic(scene, state.velocity)
            peak = max(peak, energy)
        lost = simulation.read("contacts_lost")
    at, spacing = state.position.astype(np.float64), scene.body_set.spacing
    return [
        Check("nearest particles over their distance", nearest(scene, at) / spacing, "", ">", GAP_FRACTION),
        Check("kinetic energy over its peak", energy / peak, "", "<", STILL_FRACTION),
        Check("out of shape over the spacing", out_of_shape(scene, at) / spacing, "", "<", 1.0),
        Check("contacts that found no room", float(lost), "", "<", 1.0),
    ]


def lies_still(trial: Trial) -> list[Check]:
    """B18: dropped from 0.5 m, 1e-6 of that energy is left after 10 s, and nothing is below the plane."""
    scene, state = trial.scene, trial.run(None, SECONDS)
    spacing = scene.body_set.spacing
    drop = masses(scene).sum() * GRAVITY * 0.5
    lowest = float(state.position[:, 1].min())
    checks = [
        Check("kinetic energy over the drop's", kinetic(scene, state.velocity) / drop, "", "<", STILL),
        Check("lowest particle, under the plane's reach", spacing / 2 - lowest, "m", "<", 4 * ULP[trial.precision]),
    ]
    if len(scene.body_set.copies) > 1:
        apart = nearest(scene, state.position.astype(np.float64)) / spacing
        checks.append(Check("nearest particles over their distance", apart, "", ">", GAP_FRACTION))
    return checks


def _lowered(trial: Trial, at: np.ndarray, body: int) -> float:
    """Return the downward displacement [m] of the mean of a body's particles."""
    members = trial.scene.body_set.body == body
    return float((trial.scene.body_set.position - at)[members, 1].mean())


def _quiet(trial: Trial, state: State, height: float, load: float = 1.0) -> list[Check]:
    """Checks that nothing leans and nothing moves.

    Friction reverts the sliding of a substep, and has no memory. The allowed lean is that of rotations that lag behind,
    always in the same direction, in all substeps over `height` [m], `load` times as large for a body under such a load,
    and at most a tenth of a particle's distance.
    """
    scene = trial.scene
    tilt = np.abs(state.position - scene.body_set.position)[:, [0, 2]].max()
    substeps = scene.method.substeps * trial.steps(SECONDS)
    slid = substeps * LAG * ULP[trial.precision] * height * load
    weight = float(masses(scene).sum()) * GRAVITY
    energy = kinetic(scene, state.velocity) / (weight * height)
    return [
        Check("lean", float(tilt), "m", "<", min(slid, scene.body_set.spacing / 10)),
        Check("kinetic energy over that of a fall of its height", energy, "", "<", STILL),
    ]
