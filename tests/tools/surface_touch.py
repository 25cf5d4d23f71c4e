"""One mass against a surface collider by the formulas alone: what the tests of trees and of fields share."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from model.contact.surface_collider import SurfaceCollider
from model.mass_spring.cloth_parameters import B_TREE, COLLIDER_FIELDS, collider_numbers
from model.scene.scene import Scene


def touch_by(formulas: ModuleType, kind: str, part: SurfaceCollider, real: Any = np.float64) -> Any:
    """touch(begin, end, before, position, velocity) -> (position, velocity): the formulas on the row and the numbers of a
    collider of that kind."""
    scene = Scene({"cloth": {"rows": 2, "columns": 2}, kind: part.model_dump()})
    numbers = collider_numbers(scene, real)
    row = numbers[:COLLIDER_FIELDS]
    made = formulas.make(real)

    def touched(begin: float, end: float, before: Any, position: Any, velocity: Any) -> tuple[np.ndarray, np.ndarray]:
        vectors = [real(x) for vector in (before, position, velocity) for x in vector]
        found = made.touch(
            numbers, int(row[B_TREE]), row[10], row[11], row[12], *row[:3], *row[7:10], *row[3:6], row[13], row[14],
            real(begin), real(end), *vectors, real(0), real(0),
        )  # fmt: skip
        assert all(type(x) is real for x in found)
        return np.array(found[:3]), np.array(found[3:])

    return touched


def fall_by(meet: Any, place: Any, velocity: Any, steps: int, dt: float, gravity: float = 9.81) -> Any:
    """(position, velocity) of a mass that meets a collider, by semi-implicit Euler."""
    p, v = np.array(place, float), np.array(velocity, float)
    for step in range(steps):
        v = v - [0, gravity * dt, 0]
        p, v = meet(step * dt, (step + 1) * dt, p, p + dt * v, v)
    return p, v
