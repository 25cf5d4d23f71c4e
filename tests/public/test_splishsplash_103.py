"""SPlisHSPlasH 103: a mesh collider throws fluid back.

The wall's factor was made at the predicted place, behind the mesh, where its distance has a small slope: one particle came
back at 9.2 m/s of 10 (macklin, 2 iterations), 10.9 (averaged), and lost its velocity along the mesh. Many substeps of the
divergence-free scheme threw it back from any collider, at 1.2 m/s.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.bench.reference.fluid import simulate
from softlab.model.core.build import build
from softlab.model.fluid.family import springs_back
from softlab.model.scene.scene import Scene

D, SPEED, ALONG = 0.1, 10.0, 1.0  # m, m/s
MESH: dict[str, Any] = {"shape": {"name": "box", "sides": [2.0, 1.0, 2.0], "resolution": 1}, "origin": [0.0, -0.5, 0.0]}
COLLIDERS: dict[str, dict[str, Any]] = {  # each with its top at the origin
    "plane": {"kind": "plane"},
    "box": {"kind": "box", "center": [0.0, -0.5, 0.0], "half_size": [2.0, 0.5, 2.0]},
    "sphere": {"kind": "sphere", "center": [0.0, -50.0, 0.0], "radius": 50.0},
    "capsule": {"kind": "capsule", "start": [-1.0, -0.5, 0.0], "end": [1.0, -0.5, 0.0], "radius": 0.5},
    "mesh": MESH | {"kind": "mesh_collider"},
    "field": MESH | {"kind": "distance_field", "spacing": 0.25},
}
EFFORTS = [(1, 4), (2, 2), (4, 1), (10, 4), (16, 1)]  # substeps, iterations
SCHEMES = ("macklin", "averaged", "divergence-free")
CASES = [(kind, scheme) for kind in COLLIDERS for scheme in SCHEMES]
BY_DEFAULT = ("plane", "mesh")  # kinds that drops meet without --rest


def falling(
    collider: dict[str, Any], scheme: str, effort: tuple[int, int], thickness: float, above: float, flat: bool = False,
    across: int = 1, lift: float = 0.0,
) -> Scene:  # fmt: skip
    """A block of fluid, `across` particles long, whose lowest is `above` [m] the collider, which rises at `lift` [m/s]."""
    axes, side = 2 if flat else 3, across * D
    low = thickness + above - D / 2
    water = {
        "kind": "fluid", "dimensions": axes, "rest_distance": D, "size": [side] * axes,
        "origin": [-side / 2, low, -side / 2][:axes], "velocity": [ALONG, lift - SPEED, 0.0],
    }  # fmt: skip
    method = {"solver": "pbf", "scheme": scheme, "substeps": effort[0], "iterations": effort[1]}
    return Scene(
        {"water": water, "floor": collider | {"thickness": thickness, "velocity": [0, lift, 0]}, "method": method}
    )


def velocities(scene: Scene, steps: int = 4) -> np.ndarray:
    """(steps, axes) mean velocity [m/s] after each step, by the reference."""
    body, found = build(scene), []
    x, v = body.position, body.velocity
    for step in range(steps):
        x, v = simulate(scene, 1, x, v, step)
        found.append(v.mean(axis=0))
    return np.array(found)


@pytest.mark.parametrize(("kind", "scheme"), CASES)
def test_a_particle_stays_where_it_lands(kind: str, scheme: str) -> None:
    """Less than a tenth of its speed comes back, and all that leads along the collider stays (but for the speed limit, with
    one substep). Distance fields, which are slow here, do half of it."""
    for number, effort in enumerate(EFFORTS[1:4] if kind == "field" else EFFORTS):
        thickness, above = (D / 100, D, D / 2)[number % 3], (0.0026, 0.08)[number % 2]
        found = velocities(falling(COLLIDERS[kind], scheme, effort, thickness, above))
        assert found[:, 1].max() < 0.1 * SPEED, (effort, thickness, found)
        if effort[0] > 1:
            assert found[-1, 0] == pytest.approx(ALONG, rel=0.01), (effort, thickness, found)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize(
    ("kind", "flat", "across", "lift"), [("plane", True, 1, 0.0), ("plane", True, 4, 0.0), ("mesh", False, 1, 2.0)]
)
def test_also_in_a_plane_a_drop_and_on_what_moves(scheme: str, kind: str, flat: bool, across: int, lift: float) -> None:
    """Its speed is that from the collider's; of a drop the mean. A rising collider takes its fluid along. A drop of the
    averaged scheme gives 12 % back: its particles, not the wall, gain speed from one another."""
    most = 0.15 if scheme == "averaged" and across > 1 else 0.1
    for effort in [(2, 2), (10, 4)]:
        found = velocities(falling(COLLIDERS[kind], scheme, effort, D / 100, 0.05, flat, across, lift))[:, 1] - lift
        assert found.max() < most * SPEED, (effort, found)
        assert across > 1 or found[-1] > -0.01, (effort, found)


@pytest.mark.parametrize(
    ("kind", "scheme"), [pytest.param(*case, marks=() if case[0] in BY_DEFAULT else pytest.mark.rest) for case in CASES]
)
def test_a_drop_stays_where_it_lands(kind: str, scheme: str) -> None:
    """A drop of 64 particles: less than a tenth of its speed comes back on the mean, and no particle goes up faster than it
    came down. One that begins half a rest distance from the collider, where its lattice ends, loses energy, and less than
    4 % of its speed come back (macklin, divergence-free); one that begins nearer is pushed out by its distance over the
    substep (8 %, and 1.5 times its energy, measured with 16 substeps). Of averaged, efforts that spring back are noted."""
    tried = 0
    for number, effort in enumerate([(1, 4), (2, 2), (4, 1), (10, 4), (16, 10)]):
        thickness, above = (D / 100, D, D / 2)[number % 3], (0.0026, 0.06, 0.08)[number % 3]
        for height in (above, 0.07):
            scene = falling(COLLIDERS[kind], scheme, effort, thickness, height, across=4)
            if springs_back(scene):
                continue
            tried += 1
            with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
                start, upwards = (simulation.read("velocity") ** 2).sum(), []
                for _ in range(8):
                    simulation.advance(1)
                    velocity = simulation.read("velocity")
                    upwards.append(velocity[:, 1].mean())
                    assert velocity[:, 1].max() < SPEED, effort
                    assert height < D / 2 or (velocity**2).sum() < start, effort
            most = 0.04 if height >= D / 2 and scheme != "averaged" else 0.1
            assert max(upwards) < most * SPEED, (effort, height, upwards)
            assert kind == "capsule" or max(upwards) > -0.1 * SPEED, (
                effort,
                height,
                upwards,
            )  # it has met the collider
    assert tried >= 4


@pytest.mark.parametrize("across", [1, 4])
def test_a_body_does_not_throw_it_back(across: int) -> None:
    """A particle and a drop that fall on a block of particles, which is a million times as dense: less than a tenth of
    their speed comes back (0.05 measured) where a particle moves by at most half a rest distance in a substep."""
    side = across * D
    for number, effort in enumerate([(4, 10), (10, 4), (16, 10)]):
        water = {
            "kind": "fluid", "rest_distance": D, "size": [side] * 3, "origin": [-side / 2, (0.01, 0.03, 0.08)[number],
            -side / 2], "velocity": [ALONG, -SPEED, 0.0],
        }  # fmt: skip
        block = {
            "kind": "rigid_body", "shape": {"name": "box", "sides": [1.2, 0.6, 1.2]}, "particle_spacing": D,
            "volume_sampling": 1.0, "surface_sampling": 0.0, "density": 1e9, "origin": [0.0, -0.3, 0.0],
        }  # fmt: skip
        method = {"solver": "world", "dt": 1 / 60, "substeps": effort[0], "iterations": effort[1]}
        scene = Scene({"water": water, "block": block, "method": method})
        drop, upwards = scene.world_set.slices()["fluid"], []
        with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
            for _ in range(8):
                simulation.advance(1)
                upwards.append(simulation.read("velocity")[drop, 1].mean())
            assert simulation.read("position")[drop, 1].min() > -D, effort
        assert -0.1 * SPEED < max(upwards) < 0.1 * SPEED, (effort, upwards)


def test_a_wall_pushes_as_far_as_its_restitution_says() -> None:
    """A particle that meets a plane with restitution 0.5 within a substep leaves it at half its speed."""
    scene = falling(COLLIDERS["plane"] | {"restitution": 0.5}, "macklin", (2, 2), 0.0, 0.04)
    assert velocities(scene, 1)[0] == pytest.approx([ALONG, SPEED / 2, 0.0], rel=1e-6)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_compiled_kernels_do_so_too(precision: str) -> None:
    """The reported scene, on CPU threads."""
    scene = falling(COLLIDERS["mesh"], "macklin", (2, 2), 0.001, 0.0026)
    with open_simulation(scene, "cpu", precision=precision, math="exact", threads=1) as simulation:
        simulation.advance(1)
        velocity = simulation.state().velocity[0]
    assert np.abs(velocity - velocities(scene, 1)[0]).max() < (1e-4 if precision == "float32" else 1e-10)
    assert abs(velocity[1]) < 0.1 * SPEED
