"""Spray, foam and bubbles: where they come from, how each moves, that they are repeatable and do nothing to the fluid."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.bench.reference.contact.mesh_collider import first_crossing
from softlab.model.base.errors import SceneError
from softlab.model.fluid.foam import BUBBLE, FOAM, RISING, SPRAY, YOUNGEST, FoamPoints
from softlab.model.fluid.foam_sources import CREST, FAST, SURFACE, TRAPPED, WEIGHT, foaming_speed, full_count, sources
from softlab.model.fluid.foam_walls import GAP, outward, pushed_out
from softlab.model.scene.scene import Scene
from softlab.model.tables.colliders.mesh_collider import MeshCollider
from softlab.model.tables.fluid import Foam

METHOD = {"solver": "pbf", "dt": 0.01, "substeps": 2, "iterations": 2}
DT, SIDE = 0.01, 0.1
DIMENSIONS = pytest.mark.parametrize("axes", [2, 3])


def water(axes: int = 3, size: float = 1.0, **others: Any) -> Scene:
    table = {"kind": "fluid", "dimensions": axes, "size": [size] * axes, "rest_distance": SIDE}
    return Scene({"water": table, "method": METHOD, "gravity": {}} | others)


def one_point(scene: Scene, foam: Foam, place: np.ndarray, velocity: np.ndarray, left: float = 1.0) -> FoamPoints:
    points = FoamPoints(scene, foam)
    points.follow(scene.fluid_set.position, scene.fluid_set.velocity, 0.0)
    points._set_points(place[None].astype(float), velocity[None].astype(float), np.array([left]))
    points.kind = np.zeros(1, np.int8)
    return points


@DIMENSIONS
def test_spray_flies_as_a_stone(axes: int) -> None:
    """v after n steps is v0 - n g dt, and the place the sum of those: y0 + v0 t - g t (t + dt) / 2; it does not grow old."""
    scene = water(axes)
    start, speed = np.full(axes, 3.0), np.arange(1.0, axes + 1)
    points = one_point(scene, Foam(rate=0.0), start, speed, left=DT / 2)
    for step in range(1, 31):
        points.follow(scene.fluid_set.position, scene.fluid_set.velocity, step * DT)
    time = 30 * DT
    expected = start + speed * time
    expected[1] -= 9.81 * time * (time + DT) / 2
    assert points.kind.tolist() == [SPRAY]
    np.testing.assert_allclose(points.position[0], expected, atol=1e-12)


@DIMENSIONS
def test_foam_goes_with_the_fluid_until_its_time_is_over(axes: int) -> None:
    """At the top of a block that moves as a whole: the mean of equal velocities is that velocity."""
    scene, velocity = water(axes), np.array([0.3, 0.2, -0.1])[:axes]
    middle = np.full(axes, 0.5)
    middle[1] = 1.0  # half of its neighbourhood is fluid
    points = one_point(scene, Foam(rate=0.0), middle, np.zeros(axes), left=10.5 * DT)
    for step in range(1, 11):
        moved = scene.fluid_set.position + (step - 1) * DT * velocity
        points.follow(moved, np.broadcast_to(velocity, moved.shape), step * DT)
        assert points.kind.tolist() == [FOAM]
    np.testing.assert_allclose(points.position[0], middle + 10 * DT * velocity, atol=1e-12)
    points.follow(moved, np.broadcast_to(velocity, moved.shape), 11 * DT)
    assert len(points) == 0


@DIMENSIONS
def test_bubbles_rise_at_the_speed_that_buoyancy_and_drag_agree_on(axes: int) -> None:
    """In still fluid v = (v + b g dt) e^(-k dt): b g dt / (e^(k dt) - 1), which is b g / k, a seventh of the speed, as dt
    goes to 0."""
    scene, foam = water(axes, 2.0), Foam(rate=0.0)
    points = one_point(scene, foam, np.full(axes, 0.7), np.zeros(axes))
    drag = foam.buoyancy * 9.81 / (RISING * foaming_speed(scene, foam))
    for step in range(1, 41):
        before = points.position.copy()
        points.follow(scene.fluid_set.position, scene.fluid_set.velocity, step * DT)
    assert points.kind.tolist() == [BUBBLE]
    rise = (points.position - before)[0] / DT
    np.testing.assert_allclose(
        rise[1], foam.buoyancy * 9.81 * DT / np.expm1(drag * DT), rtol=1e-3
    )  # e^(-40 k dt) < 1e-3
    np.testing.assert_allclose(np.delete(rise, 1), 0, atol=1e-12)
    assert np.exp(-40 * drag * DT) < 1e-3


@DIMENSIONS
@pytest.mark.parametrize("turn", [0.0, 0.5, 1.0])
def test_air_is_trapped_by_what_comes_together(axes: int, turn: float) -> None:
    """Two particles alone: |v| (1 - cos) (1 - r/h) over a full neighbourhood: 0 of those that part, most of those that
    meet. One that goes the way of its normal, away from the other one, is a crest as well: their normals are opposite."""
    scene = water(axes, SIDE, more={"kind": "fluid", "dimensions": axes, "size": [SIDE] * axes, "rest_distance": SIDE})
    foam, apart = Foam(speed=1.0), np.zeros(axes)
    apart[0] = 0.5 * scene.fluid_set.support
    velocity = np.zeros((2, axes))
    velocity[1, 0], velocity[1, 1] = np.cos(np.pi * turn), np.sin(np.pi * turn)
    found = sources(scene, foam, np.stack([np.zeros(axes), apart]), velocity)
    part = {2: np.pi, 3: 4 * np.pi / 3}[axes] * (scene.fluid_set.support / SIDE) ** axes * WEIGHT[axes]
    trapped = (1 - np.cos(np.pi * turn)) * 0.5 / part
    crest = 2 * 0.5 / part * (turn == 0.0 and 0.5 / part > SURFACE)
    assert found[0] == 0, "it rests"
    expected = sum(
        np.clip((one - low) / (high - low), 0, 1) for one, (low, high) in ((trapped, TRAPPED), (crest, CREST))
    )
    assert found[1] == pytest.approx(expected / 2, abs=1e-12)


def test_what_is_slow_makes_none_and_a_crest_makes_more_than_a_plane() -> None:
    scene = water(3)
    foam, place = Foam(speed=1.0), scene.fluid_set.position
    up = np.zeros_like(place)
    up[:, 1] = 0.99 * FAST[0]
    assert not sources(scene, foam, place, up).any()
    up[:, 1] = 1.0
    made = sources(scene, foam, place, up)
    top = np.isclose(place[:, 1], place[:, 1].max())
    middle = top & (np.abs(place[:, ::2] - 0.5) < 0.2).all(axis=1)
    edge = top & (np.abs(place[:, 0] - 0.5) > 0.44) & (np.abs(place[:, 2] - 0.5) < 0.2)
    assert made[middle].max() == 0 and made[edge].min() > 0
    assert not made[~top & (place[:, 1] < 0.5)].any(), "normals that look down do not go up"


@DIMENSIONS
def test_as_many_are_made_as_sources_say_and_always_the_same(axes: int) -> None:
    """Their number: rate dt sum(share), a fraction by chance, whose variance is a quarter a particle at most; each within the
    cylinder that its particle sweeps."""
    scene, foam = water(axes), Foam(speed=1.0, rate=2000.0)
    random = np.random.default_rng(1)
    place = scene.fluid_set.position
    velocity = random.uniform(-2, 2, place.shape)
    share = sources(scene, foam, place, velocity)
    clouds = [FoamPoints(scene, foam), FoamPoints(scene, foam), FoamPoints(scene, foam.model_copy(update={"seed": 1}))]
    for points in clouds:
        for step in range(2):
            points.follow(place, velocity, step * DT)
    first, second, other = clouds
    expected = foam.rate * DT * share.sum()
    assert expected > 100 and abs(len(first) - expected) < 5 * 0.5 * np.sqrt((share > 0).sum())
    for name in ("position", "velocity", "left", "kind"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()
    assert first.position.tobytes() != other.position.tobytes()
    assert (first.left >= YOUNGEST * foam.lifetime).all() and (first.left <= foam.lifetime).all()
    reach = SIDE / 2 + DT * 2 * np.sqrt(axes) + 1e-12
    near = np.linalg.norm(first.position[:, None] - place, axis=-1).min(axis=1)
    assert near.max() <= reach


def test_there_are_never_more_than_told_and_an_earlier_time_begins_anew() -> None:
    scene, foam = water(2), Foam(speed=0.1, rate=5000.0, most=50)
    velocity = np.random.default_rng(2).uniform(-1, 1, scene.fluid_set.position.shape)
    points = FoamPoints(scene, foam)
    for step in range(4):
        points.follow(scene.fluid_set.position, velocity, step * DT)
    assert len(points) == 50
    points.follow(np.full_like(velocity, np.nan), velocity, 5 * DT)
    assert len(points) == 50 and np.isfinite(points.position).all()
    points.follow(scene.fluid_set.position, velocity, 0.0)
    assert len(points) == 0


SHAPES: dict[str, dict[str, Any]] = {
    "floor": {"kind": "plane", "normal": [0.6, 0.8, 0.0], "point": [0.0, 0.2, 0.0]},
    "ball": {"kind": "sphere", "center": [0.5, 0.5, 0.0], "radius": 0.4, "velocity": [1.0, 0.0, 0.0]},
    "rod": {"kind": "capsule", "start": [0.0, 0.0, 0.0], "end": [1.0, 1.0, 0.0], "radius": 0.3},
    "block": {"kind": "box", "center": [0.4, 0.6, 0.0], "half_size": [0.3, 0.2, 0.5]},
}


@pytest.mark.parametrize("name", SHAPES)
@DIMENSIONS
def test_points_are_kept_out_of_colliders(name: str, axes: int) -> None:
    """Out to the surface by the nearest way, those outside left alone; of velocities only what goes in is taken."""
    scene = water(axes, **{name: SHAPES[name]})
    random = np.random.default_rng(3)
    place, velocity = random.uniform(-0.5, 1.5, (500, axes)), random.uniform(-1, 1, (500, axes))
    collider, time = scene.parts[name], 0.25
    solid = np.pad(place, ((0, 0), (0, 3 - axes)))
    distance, normal = outward(collider, solid, time) or (np.zeros(0), np.zeros(0))
    put, moving, met = pushed_out(scene, place, 0 * place, velocity, time, 0.0)
    assert met.any() and not met.all() and (met == (distance < 0)).all()
    assert (put[~met] == place[~met]).all() and (moving[~met] == velocity[~met]).all()
    after, _ = outward(collider, np.pad(put, ((0, 0), (0, 3 - axes))), time) or (np.zeros(0), None)
    in_plane = np.abs(normal[:, axes:]).max(axis=1, initial=0) < 1e-12
    np.testing.assert_allclose(after[met & in_plane], 0, atol=1e-12)
    np.testing.assert_allclose(
        np.linalg.norm(put - place, axis=1)[met & in_plane], -distance[met & in_plane], atol=1e-12
    )
    own = np.asarray(collider.velocity)  # type: ignore[attr-defined]
    into = ((np.pad(moving, ((0, 0), (0, 3 - axes))) - own) * normal).sum(axis=1)
    assert into[met & in_plane].min() > -1e-12


def test_no_point_passes_a_mesh_that_moves_and_turns() -> None:
    """By the judge of masses, which asks every triangle: who crosses none is left alone, and nobody has crossed one in the
    end, as the mesh saw the ways. Who met one triangle is GAP before its plane, and nothing of its velocity leads into that,
    against the mesh's own there."""
    ground = {"kind": "mesh_collider", "shape": {"name": "blob", "resolution": 24}, "velocity": [0.5, 2.0, 0.0]}
    scene = water(3, ground=ground | {"spin": [0.0, 0.0, 1.0], "origin": [0.2, 0.0, 0.1]})
    mesh, time, random = scene.parts["ground"], 0.25, np.random.default_rng(4)
    assert isinstance(mesh, MeshCollider)
    place, way = random.uniform((-0.2, 0.0, -0.4), (0.8, 1.0, 0.6), (150, 3)), random.uniform(-0.4, 0.4, (150, 3))
    put, moving, met = pushed_out(scene, place, way, way / DT, time, DT)
    begin, end, led = (
        (where - mesh.origin - np.array(mesh.velocity) * when) @ mesh.turn_at(when)
        for where, when in ((place - way, time - DT), (place, time), (put, time))
    )
    corners = mesh.position[mesh.triangles]
    crossed = [first_crossing(corners, *ends) for ends in zip(begin, end, strict=True)]
    assert met.tolist() == [one is not None for one in crossed] and 20 < met.sum() < 130
    assert not any(first_crossing(corners, *ends) for ends in zip(begin, led, strict=True))
    assert (put[~met] == place[~met]).all() and (moving[~met] == (way / DT)[~met]).all()
    one_plane = 0
    for k, (part, normal) in ((k, one) for k, one in enumerate(crossed) if one is not None):
        off, led_by = (led[k] - begin[k] - part * (end - begin)[k]) @ normal, (led - end)[k]
        if np.linalg.norm(np.cross(led_by, normal)) > 1e-12:
            continue  # it met another triangle then
        one_plane += 1
        assert off == pytest.approx(GAP * SIDE, abs=1e-12)
        turned = mesh.turn_at(time) @ normal
        own = np.array(mesh.velocity) + np.cross(mesh.spin, put[k] - mesh.origin - np.array(mesh.velocity) * time)
        assert (moving[k] - own) @ turned > -1e-9
    assert one_plane > met.sum() / 2


def test_points_are_kept_out_of_a_distance_field() -> None:
    """Of a box: as of the box itself, within what interpolation makes wrong of a distance, sqrt(3) / 2 of a cell
    (model/formulas/distance_field.py); and the way out is as long as the field says that it is deep."""
    spacing, half = 0.05, np.array([0.3, 0.2, 0.25])
    box = {"kind": "box", "center": [0.0, 0.0, 0.0], "half_size": half.tolist()}
    field = {"kind": "distance_field", "shape": {"name": "box", "sides": (2 * half).tolist()}, "spacing": spacing}
    scene, place = water(3, block=field), np.random.default_rng(5).uniform(-1, 1, (300, 3)) * (half + 1.5 * spacing)
    distance, normal = outward(scene.parts["block"], place, 0.0) or (np.zeros(0), np.zeros(0))
    known, _ = outward(water(3, block=box).parts["block"], place, 0.0) or (np.zeros(0), np.zeros(0))
    wrong = np.sqrt(3) / 2 * spacing
    assert np.abs(distance - known).max() < wrong
    put, moving, met = pushed_out(scene, place, 0 * place, -normal, 0.0, 0.0)
    assert (met == (distance < 0)).all() and met.sum() > 50
    np.testing.assert_allclose(np.linalg.norm(put - place, axis=1), np.maximum(-distance, 0), atol=1e-12)
    assert (moving[met] * normal[met]).sum(axis=1).min() > -1e-12 and (moving[~met] == -normal[~met]).all()
    assert (outward(scene.parts["block"], put, 0.0) or [np.zeros(0)])[0].min() > -2 * wrong


def test_what_leaves_a_repeating_box_comes_in_again() -> None:
    domain = {"size": [1.0, 1.0], "repeats": ["x", "y"]}
    scene = water(2, domain=domain)
    velocity = np.broadcast_to([3.0, 0.0], scene.fluid_set.position.shape)
    points = one_point(scene, Foam(rate=0.0), np.array([0.99, 0.5]), np.array([3.0, 0.0]))
    points.follow(scene.fluid_set.position, velocity, DT)
    assert points.kind.tolist() == [BUBBLE], "there is fluid on the other side"
    assert 0 <= points.position[0, 0] < 0.1


def test_a_fluid_is_the_same_with_and_without() -> None:
    plain, foaming = water(2), water(2, foam={"rate": 10.0})
    found = []
    for scene in (plain, foaming):
        with open_simulation(scene, "cpu", threads="1", math="exact") as simulation:
            simulation.advance(5)
            found.append(simulation.read("position").tobytes() + simulation.read("velocity").tobytes())
    assert found[0] == found[1]


def test_foam_is_for_fluids() -> None:
    with pytest.raises(SceneError, match="applies to fluids"):
        Scene({"grid": {"rows": 2, "columns": 2}, "foam": {}})
    assert full_count(water(3)) == pytest.approx(4 / 3 * np.pi * 0.55**-3)
