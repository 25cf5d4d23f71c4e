"""Sampled signed distances as colliders: samples, what lies between them, laws of contact, what moves.

Formulas run here as plain Python; the compiled ones give the same bits.
"""

from __future__ import annotations

from math import atan, cos, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from closed_meshes import ball, both, box
from cloth_solve import cloth
from field_scenes import BLOCK, TORUS, block
from surface_touch import check_compiled, check_formulas, fall_by, touch_by

from softlab.bench.reference import cloth as judge
from softlab.bench.reference.contact.mesh_collider import nearest_point
from softlab.cpu_backend.contact import distances
from softlab.model.base.variant import plain_formulas
from softlab.model.formulas import distance_field as formulas
from softlab.model.formulas.distance_field import SETTLED
from softlab.model.geometry import signed_distance
from softlab.model.geometry.signed_distance import sampled, signed_distances
from softlab.model.geometry.voxels import winding_numbers
from softlab.model.tables.colliders.distance_field import DistanceField, Field

each_precision = pytest.mark.parametrize("real", [np.float32, np.float64])


def field_of(distance: Any, spacing: float, half: float) -> np.ndarray:
    """The numbers of a field of `distance` (x, y, z) on a grid of 2 `half` around the origin."""
    count = round(2 * half / spacing) + 1
    low = np.full(3, -(count - 1) / 2 * spacing)
    x, y, z = np.meshgrid(*3 * [low[0] + spacing * np.arange(count)], indexing="ij")
    return np.concatenate([[count - 1] * 3, low, [1 / spacing, 0.1], distance(x, y, z).ravel()])


def touch(part: DistanceField, real: Any = np.float64, in_place: bool = False) -> Any:
    """See `touch_by`."""
    return touch_by(formulas, "distance_field", part, real, in_place)


def fall(part: DistanceField, place: Any, velocity: Any, steps: int, dt: float) -> Any:
    """See `fall_by`."""
    return fall_by(touch(part), place, velocity, steps, dt)


# ---------------------------------------------------------------------- the samples


def test_samples_are_the_distances_to_the_nearest_triangle() -> None:
    """Of a ball and a block that run into each other: the reference's nearest point, triangle by triangle, and the sign of
    the winding number."""
    position, triangles = both(ball(0.5), box((0.4, 0.3, 1.4), (0.3, 0.1, 0.05)))
    low, counts, spacing = np.array([-0.63, -0.61, -0.79]), np.array([11, 10, 13]), 0.13
    distance, overlaps = signed_distances(position, triangles, low, counts, spacing)
    points = low + spacing * np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), -1).reshape(-1, 3)
    away = [np.linalg.norm(p - nearest_point(position[triangles], p)) for p in points]
    np.testing.assert_allclose(np.abs(distance).ravel(), away, rtol=0, atol=16 * 2.0**-53)
    assert np.array_equal(distance.ravel() < 0, winding_numbers(points, position, triangles) > 0.5)
    assert overlaps and not signed_distances(*ball(0.5), low, counts, spacing)[1]


def test_samples_do_not_depend_on_threads_or_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit by bit: the least of the same numbers, from whichever triangle the walk begins."""
    position, triangles = both(ball(0.5), box((0.4, 0.3, 1.4), (0.3, 0.1, 0.05)))
    given = position, triangles, np.array([-0.63, -0.61, -0.79]), np.array([11, 10, 13]), 0.13
    found, _ = signed_distances(*given)
    for threads, batch in ((1, 1 << 14), (3, 1), (2, 40)):
        monkeypatch.setattr(distances, "core_count", lambda threads=threads: threads)
        monkeypatch.setattr(signed_distance, "BATCH", batch)
        assert np.array_equal(signed_distances(*given)[0], found), (threads, batch)


def test_a_block_is_sampled_as_the_closed_form_has_it() -> None:
    field = block(thickness=0.05).field
    count = field.distance.shape
    assert count == (13, 13, 13) and field.margin == 0.25 and field.spacing == 0.125
    x, y, z = (np.abs(field.low[k] + 0.125 * np.arange(13)) - 0.5 for k in range(3))
    x, y, z = np.meshgrid(x, y, z, indexing="ij")
    out = np.sqrt(np.maximum(x, 0) ** 2 + np.maximum(y, 0) ** 2 + np.maximum(z, 0) ** 2)
    closed = out + np.minimum(np.maximum(np.maximum(x, y), z), 0)
    np.testing.assert_allclose(field.distance, closed, rtol=0, atol=8 * 2.0**-53)


def test_what_takes_long_is_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(signed_distance, "cache_folder", lambda name: tmp_path / name)
    given = (*ball(0.5), np.full(3, -0.7), np.array([8, 8, 8]), 0.2)
    first, overlaps = sampled(*given)
    assert not list(tmp_path.rglob("*.npz"))  # too quick
    monkeypatch.setattr(signed_distance, "WORTH_KEEPING", 0.0)
    sampled(*given)
    (file,) = tmp_path.rglob("*.npz")
    monkeypatch.setattr(signed_distance, "signed_distances", lambda *args: pytest.fail("sampled again"))
    again, told = sampled(*given)
    assert np.array_equal(again, first) and told is overlaps is False
    file.write_bytes(file.read_bytes()[:100])
    monkeypatch.undo()
    monkeypatch.setattr(signed_distance, "cache_folder", lambda name: tmp_path / name)
    assert np.array_equal(sampled(*given)[0], first)  # damaged: made again


# ---------------------------------------------------------------------- between them


def test_a_ball_is_of_second_order_its_normal_of_first() -> None:
    """A distance r - R is wrong by at most h^2/8 (1/r + 1/r) within a cell, whose points lie no nearer to the middle than
    r - sqrt(3) h; halving h leaves a quarter of it. Its normal: a difference quotient over a cell, wrong by at most h/2 of
    each axis's second derivatives, under h / r in all."""
    made, random = plain_formulas(formulas, np.float64), np.random.default_rng(2)
    points = random.normal(size=(400, 3))
    points *= (random.uniform(0.7, 1.3, 400) / np.linalg.norm(points, axis=1))[:, None]
    radius = np.linalg.norm(points, axis=1)
    worst, leaning = [], []
    for spacing in (0.1, 0.05, 0.025):
        numbers = field_of(lambda x, y, z: np.sqrt(x * x + y * y + z * z) - 1, spacing, 1.5)
        found = np.array([made.sample(numbers, 0, *p) for p in points])
        off = np.abs(found[:, 0] - (radius - 1))
        assert (off <= spacing**2 / 4 / (radius - sqrt(3) * spacing)).all()
        normal = found[:, 1:] / np.linalg.norm(found[:, 1:], axis=1)[:, None]
        lean = np.linalg.norm(normal - points / radius[:, None], axis=1)
        assert (lean <= spacing / (radius - sqrt(3) * spacing)).all()
        worst.append(off.max())
        leaning.append(lean.max())
    assert np.log2(worst[0] / worst[2]) / 2 == pytest.approx(2, abs=0.1)
    assert np.log2(leaning[0] / leaning[2]) / 2 == pytest.approx(1, abs=0.15)


def test_a_block_is_exact_over_its_sides_and_off_by_a_cell_at_its_edges() -> None:
    """Where one side is nearest to a whole cell, and beside it, the distance is linear, and the normal the side's; elsewhere
    it is off by no more than sqrt(3)/2 cells, a distance being Lipschitz: weighted over a cell, |corner - point| is at most
    that."""
    field = block()
    numbers, made, random = field.numbers(np.float64), plain_formulas(formulas, np.float64), np.random.default_rng(3)
    points = random.uniform(-0.7, 0.7, (500, 3))
    closed, normals = judge.distances(judge_box(), points, 0.0)
    for p, distance, normal in zip(points, closed, normals, strict=True):
        found, *slope = made.sample(numbers, 0, *p)
        assert abs(found - distance) <= sqrt(3) / 2 * 0.125
        top = np.sort(np.abs(p))
        beside = (
            top[1] < 0.375 and top[2] - top[1] > 0.25
        )  # a cell away from the edges, and from where two sides are near
        if beside:
            assert found == pytest.approx(distance, abs=1e-14)
            assert np.array(slope) / np.linalg.norm(slope) == pytest.approx(normal, abs=1e-13)


def judge_box() -> Any:
    from softlab.model.tables.cloth import Box

    return Box(half_size=(0.5, 0.5, 0.5))


def test_outside_the_box_there_is_a_bound_and_at_its_end_the_last_cell() -> None:
    field = block(thickness=0.05)
    numbers, made = field.numbers(np.float64), plain_formulas(formulas, np.float64)
    assert made.sample(numbers, 0, 0.75, 0.75, 0.75)[0] == field.field.distance[-1, -1, -1]
    assert made.sample(numbers, 0, 0.75, 0.1, 0.0)[0] == pytest.approx(0.25, abs=1e-15)
    for place, least in (((0.85, 0.0, 0.0), 0.35), ((0.0, -3.0, 0.8), 2.5), ((9.0, 9.0, 9.0), 8.5)):
        distance, *slope = made.sample(numbers, 0, *place)
        assert distance == pytest.approx(least, abs=1e-12) and slope == [0, 0, 0]
    for wrong in (np.nan, np.inf):
        meet = touch(field)
        with np.errstate(invalid="ignore"):
            position, velocity = meet(0, 0.01, (0.0, 0.6, 0.0), (0.0, wrong, 0.0), (1.0, 0.0, 0.0))
        assert not np.isfinite(position[1]) and velocity.tolist() == [1, 0, 0]


@each_precision
def test_its_own_interpolation_is_the_formulas(real: Any) -> None:
    part = DistanceField(shape=TORUS, spacing=0.07)
    points = np.random.default_rng(4).uniform([-0.5, -0.2, -0.5], [0.5, 0.2, 0.5], (100, 3))
    made, numbers = plain_formulas(formulas, real), part.numbers(real)
    found = [made.sample(numbers, 0, *map(real, p))[0] for p in points]
    np.testing.assert_allclose(found, part.field.at(points), rtol=0, atol=40 * float(np.finfo(real).eps))


# ---------------------------------------------------------------------- nothing stays inside


@each_precision
def test_no_mass_passes_a_plate_at_100_metres_a_second(real: Any) -> None:
    """A way of 1.67 m through a plate 5 cm thick, whose middle it leaves far behind: a mass ends on its side, at the
    thickness, where its way entered, at the velocity along the plate."""
    plate = DistanceField(shape=BLOCK | {"sides": (1.0, 0.05, 1.0)}, thickness=0.02)
    meet, random = touch(plate, real), np.random.default_rng(5)
    for side in (1, -1) * 20:
        target = random.uniform(-0.4, 0.4, 3) * [1, 0, 1] + [0, side * 0.025, 0]
        way = np.array([random.uniform(-0.5, 0.5), -side, random.uniform(-0.5, 0.5)]) * 100 / 60
        before = (target - random.uniform(0.1, 0.9) * way).astype(real)
        position, velocity = meet(0, 1 / 60, before, before + way.astype(real), way * 60)
        assert position == pytest.approx(target + np.array([0, side * 0.02, 0]), abs=100 * float(np.finfo(real).eps))
        assert velocity == pytest.approx(way * [60, 0, 60], abs=1e4 * float(np.finfo(real).eps))


def test_who_is_inside_is_led_out_however_deep() -> None:
    """From anywhere in a torus within a few steps; from the middle of a block, in the middle of a cell, where there is no
    gradient, as well: up where a mass rests, and back along its way."""
    torus = DistanceField(shape=TORUS, spacing=0.05, thickness=0.03)
    meet, random, field = touch(torus), np.random.default_rng(6), torus.field
    start = random.uniform([-0.5, -0.15, -0.5], [0.5, 0.15, 0.5], (150, 3))
    start = start[field.at(start) < 0]
    assert len(start) > 40
    for p in start:
        for step in range(3):
            p, v = meet(step * 0.01, (step + 1) * 0.01, p, p, np.zeros(3))
        assert field.at(p[None])[0] >= 0.03 * SETTLED and not v.any()
    middle = block(spacing=1 / 9, thickness=0.03)
    meet, made = touch(middle), plain_formulas(formulas, np.float64)
    assert np.abs(made.sample(middle.numbers(np.float64), 0, 0.0, 0.0, 0.0)[1:]).max() < 1e-15
    for before, out in (((0.0, 0.0, 0.0), (0.0, 0.53, 0.0)), ((0.1, 0.0, 0.0), (0.53, 0.0, 0.0))):
        p, v = meet(0, 0.01, before, np.zeros(3), np.zeros(3))
        assert p == pytest.approx(out, abs=0.03 / 64 + 1e-12) and not v.any()


def test_a_mass_outside_is_not_touched() -> None:
    meet = touch(block(thickness=0.05))
    for before, place in (
        ((0.0, 0.57, 0.0), (0.0, 0.56, 0.1)), ((0.3, 0.9, 0.0), (0.9, 0.3, 0.0)), ((3.0, 2.0, 0.0), (2.0, 3.0, 1.0)),
    ):  # fmt: skip
        position, velocity = meet(0, 0.01, before, place, (1.0, -1.0, 0.5))
        assert (position.tolist(), velocity.tolist()) == (list(place), [1.0, -1.0, 0.5])


def test_a_mesh_of_a_ball_is_the_ball_within_both_errors() -> None:
    """Facets lie within a ball by at most their sagitta s, and interpolation is wrong by h^2/(4 (r - sqrt(3) h)), and where
    facets meet by what they turn, c / r, over a cell."""
    radius, spacing, thickness = 0.5, 0.05, 0.05
    position, triangles = ball(radius, 4)
    a, b, c = np.moveaxis(position[triangles], 1, 0)
    sides = [np.linalg.norm(x - y, axis=1) for x, y in ((a, b), (b, c), (c, a))]
    circumradius = (sides[0] * sides[1] * sides[2] / (2 * np.linalg.norm(np.cross(b - a, c - a), axis=1))).max()
    sagitta = radius - sqrt(radius**2 - circumradius**2)
    low, points = np.full(3, -0.7), np.full(3, 29)
    distance, overlaps = signed_distances(position, triangles, low, points, spacing)
    field = Field(distance, low, spacing, 0.2, overlaps)
    random = np.random.default_rng(7).normal(size=(300, 3))
    places = random / np.linalg.norm(random, axis=1)[:, None] * np.linspace(radius, radius + thickness, 300)[:, None]
    off = field.at(places) - np.linspace(0, thickness, 300)
    smooth, turned = spacing**2 / 4 / (radius - sqrt(3) * spacing), spacing * circumradius / radius
    assert sagitta < 0.002 and (off > -1e-12).all()
    assert off.max() <= sagitta + smooth + turned


@each_precision
def test_a_mass_at_rest_rests(real: Any) -> None:
    meet, dt = touch(block(thickness=0.05, static_friction=0.3), real), real(0.01)
    p, v = np.array([0.3, 0.55, 0.2], real), np.zeros(3, real)
    for step in range(200):
        v = v - np.array([0, real(9.81) * dt, 0], real)
        p, v = meet(step * dt, (step + 1) * dt, p, p + dt * v, v)
    assert np.abs(v).max() <= 4 * np.finfo(real).eps
    assert np.abs(p - np.array([0.3, 0.55, 0.2], real)).max() <= 4 * np.finfo(real).eps


# ---------------------------------------------------------------------- what moves


def test_a_block_carries_a_mass() -> None:
    """It rises at 0.5 m/s and goes sideways at 0.2: what stuck to it has its velocity, at the thickness above it, and has
    gone with it since it landed."""
    part = block(origin=(0.0, -0.7, 0.0), velocity=(0.2, 0.5, 0.0), thickness=0.02, static_friction=5.0)
    position, velocity = fall(part, (0.1, 0.0, 0.0), (0, 0, 0), 300, 0.001)
    assert velocity == pytest.approx([0.2, 0.5, 0], abs=1e-12)
    assert position[1] == pytest.approx(-0.2 + 0.3 * 0.5 + 0.02, abs=1e-12)
    again, _ = fall(part, (0.1, 0.0, 0.0), (0, 0, 0), 400, 0.001)
    assert again[0] - position[0] == pytest.approx(0.1 * 0.2, abs=1e-12)


def test_a_fast_block_sweeps_a_mass_along() -> None:
    """At 100 m/s it passes 1 m in a step, and the mass is ahead of it then, at the thickness, as fast as it is."""
    part = block(origin=(-1.0, 0.0, 0.0), velocity=(100.0, 0.0, 0.0))
    position, velocity = touch(part)(0, 0.01, (0.1, 0.2, 0.1), (0.1, 0.2, 0.1), (0.0, 0.0, 0.0))
    assert position == pytest.approx([0.51, 0.2, 0.1], abs=1e-14)
    assert velocity == pytest.approx([100, 0, 0], abs=1e-12)


def test_a_turntable_turns_what_sticks_to_it() -> None:
    """Friction takes velocities to the block's top, positions follow them: each step turns by atan(w h) and leads out by
    sqrt(1 + w^2 h^2), as a step along the tangent does."""
    spin, dt, steps = 2.0, 0.01, 60
    part = block(origin=(0.0, -0.5, 0.0), spin=(0.0, spin, 0.0), thickness=0.02, static_friction=5.0)
    position, velocity = fall(part, (0.2, 0.02, 0.0), (0, 0, -spin * 0.2), steps, dt)
    radius, angle = 0.2 * sqrt(1 + spin**2 * dt**2) ** steps, steps * atan(spin * dt)
    assert position == pytest.approx([radius * cos(angle), 0.02, -radius * sin(angle)], abs=1e-12)
    assert velocity == pytest.approx(np.cross([0, spin, 0], position), abs=1e-12)


@pytest.mark.parametrize(
    ("spin", "in_place"), [((0.0, 0.0, 0.0), False), ((1.0, 2.0, -0.5), False), ((1.0, 2.0, -0.5), True)]
)
def test_formulas_are_the_references(spin: Any, in_place: bool) -> None:
    """Of masses around and in a torus."""
    part = {
        "shape": TORUS, "spacing": 0.05, "origin": (0.1, -0.2, 0.3), "angle": 20.0, "axis": (1.0, 0.2, 0.0),
        "velocity": (0.3, 0.1, -0.2), "spin": spin, "thickness": 0.06, "static_friction": 0.3, "dynamic_friction": 0.2,
    }  # fmt: skip
    scene = cloth(10, 20, distance_field=part, method={"dt": 0.02})
    random = np.random.default_rng(8)
    position = random.uniform(-0.5, 0.5, (200, 3)) * [1, 0.5, 1] + [0.1, -0.2, 0.3]
    check_formulas(scene, touch(DistanceField(**part), in_place=in_place), position, random, 180, in_place)


@each_precision
def test_compiled_formulas_have_the_bits_of_plain_ones(real: Any) -> None:
    numbers = DistanceField(shape=TORUS, spacing=0.06, thickness=0.06).numbers(real)
    random = np.random.default_rng(9)
    ways = random.uniform(0.01, 0.06, (200, 12))
    ways[:, :9] = random.normal(size=(200, 9)) * 0.3
    assert 30 < check_compiled(formulas, numbers, ways.astype(real)) < 190
