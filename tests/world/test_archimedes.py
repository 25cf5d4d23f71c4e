"""Bodies in water against Archimedes' law: what floats displaces what it weighs, what is heavier sinks; and water stays where
it is held. Seconds of motion by compiled kernels: behind --rest."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.scene.scene import Scene, load_scene

D, ACROSS, HIGH, TANK, BELOW = 0.025, 12, 8, 20, 6  # m; the block, its tank and the water below it, in rest distances
HOW: dict[str, Any] = {"precision": "float32", "math": "fast", "threads": 2}
WALL = {"kind": "plane", "thickness": 0.0}


def floating(density: float) -> Scene:
    """A block in the middle of a tank, already as deep as whole layers of water come to it."""
    return in_tank(density, (ACROSS, HIGH), TANK, BELOW, round(HIGH * density / 1000))


def in_tank(density: float, block: tuple[int, int], tank: int, below: int, rows: int, above: int = 0) -> Scene:
    """A block, of so many particles across and high, in the middle of a square tank: `below` layers of water under it, `rows`
    beside it and `above` over all of those."""
    across, high = block
    side, top = (tank - across) // 2, (below + rows) * D
    blocks = [
        {"origin": [x * D, below * D, z * D], "size": [nx * D, rows * D, nz * D]}
        for x, z, nx, nz in (
            (0, 0, tank, side), (0, side + across, tank, side), (0, side, side, across), (side + across, side, side, across),
        )
    ]  # fmt: skip
    if above:
        blocks.append({"origin": [0.0, top, 0.0], "size": [tank * D, above * D, tank * D]})
    sides = {
        "left": {"normal": [1.0, 0.0, 0.0]}, "right": {"normal": [-1.0, 0.0, 0.0], "point": [tank * D, 0.0, 0.0]},
        "back": {"normal": [0.0, 0.0, 1.0]}, "front": {"normal": [0.0, 0.0, -1.0], "point": [0.0, 0.0, tank * D]},
    }  # fmt: skip
    return Scene(
        {
            "water": {
                "kind": "fluid", "size": [tank * D, below * D, tank * D], "blocks": blocks, "rest_distance": D,
                "viscosity": 1.0,
            },
            "block": {
                "kind": "rigid_body", "shape": {"name": "box", "sides": [across * D, high * D, across * D]},
                "particle_spacing": D, "volume_sampling": 1.0, "surface_sampling": 0.0, "density": density,
                "origin": [tank * D / 2, (below + high / 2) * D, tank * D / 2],
            },
            "floor": WALL, **{name: WALL | more for name, more in sides.items()}, "gravity": {},
            "method": {"solver": "world", "dt": 1 / 60, "substeps": 4, "iterations": 10},
        }
    )  # fmt: skip


def test_a_submerged_cube_is_pushed_up_by_the_weight_of_its_water() -> None:
    """Archimedes: rho g V, on the mean of 20 steps after 60, where a cube of 6 layers and the water's density is put back to
    its place after each step. Where its samples counted as particles of the fluid it was 0.85 of that."""
    scene = in_tank(1000.0, (6, 6), 14, 5, 6, 5)
    block, pushes = scene.world_set.slices()["bodies"], []
    mass = scene.world_set.masses[block][:, None]
    with open_simulation(scene, **HOW) as simulation:
        start = simulation.state()
        for _ in range(80):
            simulation.advance(1)
            state = simulation.state()
            gained = (mass * state.velocity[block]).sum(axis=0)[1] / scene.method.dt
            pushes.append(gained / mass.sum() / 9.81 + 1)
            position, velocity = state.position.copy(), state.velocity.copy()
            position[block], velocity[block] = start.position[block], 0
            simulation.load(replace(state, position=position, velocity=velocity))
    assert np.mean(pushes[60:]) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize(("density", "near"), [(600.0, 0.25), (917.0, 0.16)])
def test_a_block_floats_as_deep_as_it_weighs(density: float, near: float) -> None:
    """Archimedes: depth = height times the ratio of densities, on the mean of two seconds, after one. The water's level
    follows from its volume, which it keeps to a percent (the column of NUMERICS F1). Ice within 2 % of its height, a sixth of
    a rest distance; wood within a quarter of one: water at rest gives way to no less, and where in that range it stops is
    left to rounding (docs/method/fluids.md, Among solids)."""
    scene, depths = floating(density), []
    block, water = (scene.world_set.slices()[name] for name in ("bodies", "fluid"))
    free = TANK**2 - ACROSS**2
    with open_simulation(scene, **HOW) as simulation:
        simulation.advance(60)
        for _ in range(40):
            simulation.advance(3)
            foot = simulation.read("position")[block, 1].mean() / D - HIGH / 2
            level = (water.stop - water.start - ACROSS**2 * foot) / free
            depths.append(level - foot)
        assert simulation.read("contacts_lost") == 0
    assert np.mean(depths) == pytest.approx(HIGH * density / 1000, abs=near)


def test_of_three_bodies_steel_sinks() -> None:
    """The catalogue's scene: in the end steel lies on the floor, ice lower in the water than wood, whose top is dry."""
    scene = load_scene("float")
    copies, start = scene.members["bodies"].body_set.copies, scene.world_set.slices()["bodies"].start
    with open_simulation(scene, **HOW) as simulation:
        simulation.advance(150)
        height = simulation.read("position")[:, 1]
        water = np.quantile(height[scene.world_set.slices()["fluid"]], 0.98)
    wood, ice, steel = (height[copy.particles.start + start : copy.particles.stop + start] for copy in copies)
    assert steel.min() < D / 4 and steel.mean() < 0.05
    assert wood.mean() > ice.mean() > 0.1
    assert wood.max() > water + D


@pytest.mark.parametrize(("name", "kept"), [("jelly-bowl", 0.9), ("wet-cloth", 1.0)])
def test_water_stays_where_it_is_held(name: str, kept: float) -> None:
    """Nothing runs through a wall of jelly or a cloth that sags and swings, which is thinner than a particle: all water is
    over what holds it, but drops that splash over a bowl's rim; they were in its upper half when they were as far from its
    axis as that. Those of a cloth stay on it."""
    scene = load_scene(name)
    water = scene.world_set.slices()["fluid"]
    splashed = np.zeros(water.stop - water.start, bool)
    with open_simulation(scene, **HOW) as simulation:
        for _ in range(75):
            simulation.advance(1)
            place = simulation.read("position")
            solid, drops = place[: water.start], place[water]
            middle, reach = solid.mean(axis=0), np.ptp(solid, axis=0) / 2
            aside = np.abs(drops - middle)
            splashed |= (np.hypot(aside[:, 0], aside[:, 2]) > reach[0]) & (drops[:, 1] > middle[1])
    over = (aside[:, [0, 2]] < reach[[0, 2]]).all(axis=1) & (drops[:, 1] > solid[:, 1].min())
    assert (over | splashed).all(), "water runs through"
    assert over.mean() >= kept, over.mean()
