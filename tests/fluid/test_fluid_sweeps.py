"""Capsules and boxes that no way leads through: the formulas against NumPy, and a law that needs neither."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.bench.reference.fluid_world import _caught
from softlab.model.base.variant import plain_formulas
from softlab.model.formulas.fluid import sweep
from softlab.model.tables.cloth import Box, Capsule

HALF, LINE, REACH = (0.3, 0.05, 0.2), (0.4, 0.3, -0.1), 0.15
STILL = (0.0, 0.0, 0.0)


def ways(seed: int, count: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    """From somewhere around to somewhere around, a third of them from the surface of a box."""
    random = np.random.default_rng(seed)
    begin, end = random.uniform(-0.7, 0.7, (2, count, 3))
    on = slice(0, count // 3)
    begin[on] = random.uniform(-1, 1, (count // 3, 3)) * HALF
    begin[on, 1] = np.sign(begin[on, 1]) * HALF[1]
    return begin, end


def test_a_box_is_met_as_numpy_says() -> None:
    begin, end = ways(1)
    box = Box(center=STILL, half_size=HALF, thickness=0.01, velocity=STILL)
    found, stopped, normal = _caught(box, begin, end, 0.0, 1.0)
    assert 300 < found.sum() < 2500
    face = plain_formulas(sweep, float).box_face
    for k in range(len(begin)):
        depth, *n = face(*begin[k], *end[k], *HALF)
        assert any(n) == bool(found[k, 0])
        if any(n):
            assert n == list(normal[k])
            assert end[k] + (depth + 0.01) * np.array(n) == pytest.approx(stopped[k], abs=1e-14)


def test_a_capsule_is_met_as_numpy_says() -> None:
    begin, end = ways(2)
    rod = Capsule(start=STILL, end=LINE, radius=REACH, thickness=0.0, velocity=STILL)
    found, stopped, _ = _caught(rod, begin, end, 0.0, 1.0)
    assert 100 < found.sum() < 2500
    entry = plain_formulas(sweep, float).capsule_entry
    for k in range(len(begin)):
        part = entry(*begin[k], *end[k], *LINE, REACH)
        assert (part < 1) == bool(found[k, 0])
        if part < 1:
            assert begin[k] + part * (end[k] - begin[k]) == pytest.approx(stopped[k], abs=1e-13)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_nothing_that_comes_from_one_side_of_a_wide_plate_ends_on_the_other(axis: int, side: float) -> None:
    """Whatever its way is, within the plate's width: by the face that it entered, or by being led out of the nearest one."""
    random, half = np.random.default_rng(3), np.full(3, 2.0)
    half[axis] = 0.01
    face = plain_formulas(sweep, float).box_face
    for _ in range(500):
        a, b = random.uniform(-1, 1, (2, 3))
        a[axis] = side * abs(a[axis]) + side * half[axis]
        depth, *n = face(*a, *b, *half)
        b = b + depth * np.array(n)
        led_out = abs(b[axis]) <= half[axis] and b[axis] * side >= 0
        assert b[axis] * side >= half[axis] * (1 - 1e-12) or led_out
