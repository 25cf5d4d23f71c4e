"""One mass against a surface collider by the formulas alone: what the tests of trees and of fields share."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from cloth_solve import solve

from softlab.bench.reference import cloth as judge
from softlab.model.base.variant import Variant, features_of, plain_formulas
from softlab.model.contact.cloth_parameters import B_TREE, COLLIDER_FIELDS, collider_numbers
from softlab.model.scene.scene import Scene
from softlab.model.tables.colliders.surface_collider import SurfaceCollider


def touch_by(
    formulas: ModuleType, kind: str, part: SurfaceCollider, real: Any = np.float64, in_place: bool = False
) -> Any:
    """touch(begin, end, before, position, velocity) -> (position, velocity): the formulas on the row and the numbers of a
    collider of that kind; `in_place`: whose friction acts on positions."""
    scene = Scene({"cloth": {"rows": 2, "columns": 2}, kind: part.model_dump()})
    numbers = collider_numbers(scene, real)
    row = numbers[:COLLIDER_FIELDS]
    made = plain_formulas(formulas, real, {"friction_in_place": in_place})

    def touched(begin: float, end: float, before: Any, position: Any, velocity: Any) -> tuple[np.ndarray, np.ndarray]:
        vectors = [tuple(real(x) for x in vector) for vector in (before, position, velocity)]
        settling = (real(0), real(end - begin)) if in_place else real(0)
        surface = row[10], row[11], row[12], real(0), settling
        path = row[:3], row[7:10], row[3:6], row[13], row[14]
        found = made.touch(numbers, int(row[B_TREE]), surface, path, real(begin), real(end), *vectors)
        assert all(type(x) is real for vector in found for x in vector)
        return np.array(found[0]), np.array(found[1])

    return touched


def fall_by(meet: Any, place: Any, velocity: Any, steps: int, dt: float, gravity: float = 9.81) -> Any:
    """(position, velocity) of a mass that meets a collider, by semi-implicit Euler."""
    p, v = np.array(place, float), np.array(velocity, float)
    for step in range(steps):
        v = v - [0, gravity * dt, 0]
        p, v = meet(step * dt, (step + 1) * dt, p, p + dt * v, v)
    return p, v


def check_formulas(
    scene: Scene, meet: Any, position: np.ndarray, random: np.random.Generator, most: int, in_place: bool = False
) -> None:
    """Of masses at `position` (200, 3), some fast, some in contact, 30 to `most` of which meet the scene's collider:
    positions and velocities of the NumPy reference (bench/reference), within 1000 roundings of what they are made from."""
    step = 3
    velocity = random.normal(size=(200, 3)) * random.choice([0.1, 5.0, 80.0], (200, 1))
    after = position + 0.02 * velocity
    found = [meet(step * 0.02, (step + 1) * 0.02, *each) for each in zip(position, after, velocity, strict=True)]
    arrays = [array.reshape(10, 20, 3) for array in (position, after, velocity)]
    expected = judge.collide(scene, *arrays, step, in_place)
    assert (expected[0] != judge.collide(scene, *arrays, step)[0]).any() == in_place
    assert 30 < (expected[1] != arrays[2]).any(axis=-1).sum() < most
    for own, wanted, size in zip(zip(*found, strict=True), expected, (2, 200), strict=True):
        np.testing.assert_allclose(own, wanted.reshape(-1, 3), rtol=0, atol=1000 * size * 2.0**-53)


def check_falling_cloth(solver: str, scene: Scene, collider: str) -> None:
    """Solvers of a sheet meet the `collider`, too: the reference's states within 1000 roundings of 3 m, by 20 steps."""
    without = scene.replace({f"{collider}.origin": (0.0, -9.0, 0.0)})
    position, velocity = solve("reference", scene, 20)
    met = np.abs(position - solve("reference", without, 20)[0]).max(axis=1) > 0.01
    assert met.sum() > 10
    if solver != "reference":
        found = solve(solver, scene, 20)
        np.testing.assert_allclose(found[0], position, rtol=0, atol=3000 * 2.0**-53)
        np.testing.assert_allclose(found[1], velocity, rtol=0, atol=3000 * 100 * 2.0**-53)


def check_compiled(formulas: ModuleType, numbers: np.ndarray, ways: np.ndarray) -> int:
    """The formula `settle` of a collider, as numba compiles it, has the bits of plain Python for random `ways` (n, 12) of
    masses; returned: how many meet it."""
    import numba

    settle = None

    def batch(numbers, ways, out):
        for k in range(len(ways)):
            w = ways[k]
            zero = w[0] - w[0]
            surface, spin, drift = (w[9], w[10], w[10], zero, zero), (zero, w[11], zero), (zero, zero, w[11])
            met, (x, y, z), (vx, vy, vz) = settle(
                numbers, np.int32(0), surface, spin, drift, (w[0], w[1], w[2]), (w[3], w[4], w[5]), (w[6], w[7], w[8])
            )
            out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4], out[k, 5] = x, y, z, vx, vy, vz
            out[k, 6] = w[9] if met else zero

    found, plain = np.zeros((2, len(ways), 7), ways.dtype)
    compiled = numba.njit(error_model="numpy")
    settle = Variant(ways.dtype.type, compiled, features_of(())).of(formulas).settle
    compiled(batch)(numbers, ways, found)
    settle = plain_formulas(formulas, ways.dtype.type).settle
    batch(numbers, ways, plain)
    assert np.array_equal(found, plain)
    return int((found[:, 6] > 0).sum())
