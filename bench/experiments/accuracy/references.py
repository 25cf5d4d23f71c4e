"""What the runs of each accuracy scene are held against, and how much a disturbance of that scene grows.

Grids, and the cloth that touches nothing: RK4 and Richardson in NumPy (bench/reference/). A cloth that touches something:
the lab's own (bench/experiments/accuracy/contact_reference.py). A loaded rope: RK4 in NumPy, too, whose steps are short
enough to be stable on its fastest vibrations; they hardly move. Runs judged at rest: the closed form of that, with twins by
implicit Euler.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.experiments.accuracy.contact_reference import contact_converged
from bench.experiments.accuracy.methods import newton, why_unknown
from bench.experiments.accuracy.points import AT_REST
from bench.measure.growth import Growth, kept_growth
from bench.reference import cache, rope
from model.scene.scene import Scene

CLOTH_TOLERANCE = 2e-7  # spacings; RK4 at dt 0.0005 on S4 is at 3e-6, and shall be resolved tenfold
ROPE_TOLERANCE = 2e-6
ROPE_STEPS_PER_RADIAN = 0.4  # RK4 holds from 0.36 on
STILL_STEPS_PER_RADIAN = 0.002  # no step is too long for implicit Euler; its end swings at 1.75 rad/s
LEFT = 1e-8  # m: of the swing, at the time of S6-still


def motion_of(scene: Scene) -> Scene:
    """The scene that references are made of: for the solver mass-spring, but where that does not know its loads."""
    return scene if scene.loads and why_unknown(scene) is None else newton(scene)


def converged_for(label: str, scene: Scene, end: float, folder: Path | None) -> cache.Converged:
    """The state of an accuracy scene's motion (`motion_of`) at `end` [s], kept in `folder` (None: not at all)."""
    if label in AT_REST:
        position = rope.hanging(scene)
        return cache.Converged(position, np.zeros_like(position), LEFT)
    if scene.loads:
        return cache.kept(scene, end, folder, tolerance=ROPE_TOLERANCE, per_radian=ROPE_STEPS_PER_RADIAN)
    if scene.colliders:
        return contact_converged(scene, end, folder)
    if scene.cloth:
        return cache.kept(scene, end, folder, tolerance=CLOTH_TOLERANCE)
    return cache.kept(scene, end, folder)


def growth_for(label: str, scene: Scene, end: float, folder: Path | None) -> Growth:
    """How much a disturbance of that motion has grown by then."""
    if label in AT_REST:
        return kept_growth(scene, end, folder, "implicit-euler", STILL_STEPS_PER_RADIAN)
    if scene.loads:
        return kept_growth(scene, end, folder, per_radian=ROPE_STEPS_PER_RADIAN)
    return kept_growth(scene, end, folder)
