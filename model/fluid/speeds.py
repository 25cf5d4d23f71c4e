"""Comparison of the speed limit of a fluid's particles, half a support per substep, with the speeds of its scene."""

from __future__ import annotations

from math import ceil, hypot, sqrt

import numpy as np

from softlab.model.fluid.parameters import speed_limit
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Plane
from softlab.model.tables.fluid import SUPPORTS_PER_SUBSTEP

FLOOR_NORMAL = 0.9  # component along y of the unit normal of a floor, at least


def fall_height(scene: Scene) -> float:
    """Return the height [m] that a fluid of the scene can fall.

    It is measured from the highest initial particle to the highest floor below all of them, or to the lowest particle
    where there is no floor.
    """
    fluids = scene.fluid_set
    height = fluids.position[fluids.there(fluids.position), 1]
    if not len(height):
        return 0.0
    lowest, highest = float(height.min()) - fluids.spacing / 2, float(height.max()) + fluids.spacing / 2
    floors = [
        part.point[1]
        for _, part in scene.colliders
        if isinstance(part, Plane)
        and part.normal[1] > FLOOR_NORMAL * hypot(*part.normal)
        and part.point[1] <= lowest + fluids.spacing / 2
    ]
    return highest - min(lowest, max(floors, default=lowest))


def expected_speeds(scene: Scene) -> dict[str, tuple[float, str]]:
    """Return the speed [m/s] that each fluid's particles reach without losses, and its cause.

    It is the fastest initial speed, or sqrt(2 g H) of a fall by H (E. Torricelli).
    """
    fluids, speeds = scene.fluid_set, {}
    gravity = abs(scene.gravity.acceleration) if scene.gravity and scene.gravity.enabled else 0.0
    height, there = fall_height(scene), fluids.there(fluids.position)
    for number, (name, part) in enumerate(scene.fluids.items()):
        start = float(np.sqrt((fluids.velocity[there & (fluids.fluid == number)] ** 2).sum(axis=1)).max(initial=0.0))
        fall = sqrt(2 * gravity * abs(part.buoyancy) * height)
        speeds[name] = (
            (start, "starts with") if start > fall else (fall, f"reaches in a fall by {height:.3g} m, sqrt(2 g H)")
        )
    return speeds


def speed_lines(scene: Scene) -> list[str]:
    """Return a line for each fluid whose limit of half a support per substep is below its initial or its fall speed."""
    if scene.is_world:
        scene = scene.members.get("fluid", scene)
    lines = []
    for name, (speed, why) in (expected_speeds(scene) if scene.fluids else {}).items():
        part, method = scene.fluids[name], scene.method
        limit, stable = speed_limit(scene, part), SUPPORTS_PER_SUBSTEP * part.support_radius
        if limit * (1 + 1e-9) < stable * method.substeps / method.dt or limit >= speed:
            continue  # a maximum_speed was stated, or nothing is slowed
        lines.append(
            f"{name}: no particle goes faster than {limit:.3g} m/s, half a support a substep, but it {why} "
            f"{speed:.3g} m/s; method.substeps = {ceil(speed * method.dt / stable)} (now {method.substeps}) would allow that"
        )
    return lines
