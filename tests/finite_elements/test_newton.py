"""Implicit Euler of tetrahedral bodies by Newton's method: the judge's steps, statics at any stiffness, laws, hard starts.

One set of parts (gravity, dampers), so that one kernel a precision is compiled.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.bench.reference import tetrahedra_newton as reference
from softlab.model.core.simulation import Simulation, State
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.tetrahedra.block_rows import block_rows
from softlab.model.tetrahedra.material import deformation

STILL = {"gravity.acceleration": 0.0}


def bar(sides: tuple[float, float, float] = (0.5, 0.1, 0.1), edge: float = 0.1, **changes: Any) -> Scene:
    """Of `voxels` edge long, held at its left side, unless `changes`, with __ for the dot, say else."""
    fields = {"beam.shape": {"name": "box", "sides": list(sides)}, "beam.edge": edge, "beam.young_modulus": 1e5}
    method = {"method.solver": "newton", "method.substeps": 1, "method.iterations": 30}
    tables = load_scene("fem-cantilever").as_dict()
    del tables["damping"]  # the body's own instead
    scene = Scene(tables).replace(fields | method | {"beam.damping": 0.01})
    return scene.replace({name.replace("__", "."): value for name, value in changes.items()})


def opened(scene: Scene, precision: str = "float64", math: str = "exact", threads: int = 1) -> Simulation:
    return open_simulation(scene, precision=precision, math=math, threads=threads)


def start(simulation: Simulation, position: np.ndarray, velocity: np.ndarray | None = None) -> None:
    state = simulation.state()
    moving = np.zeros_like(position) if velocity is None else velocity
    simulation.load(State(position, moving, state.inverse_mass, 0.0, 0))


def shaken(simulation: Simulation, places: float, speeds: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """(position, velocity), random ones about the start of all that is free."""
    state, random = simulation.state(), np.random.default_rng(seed)
    free = (state.inverse_mass > 0)[:, None]
    position = state.position + places * random.normal(size=state.position.shape) * free
    return position, speeds * random.normal(size=state.position.shape) * free


@pytest.mark.parametrize("material", ["fixed-corotated", "corotated", "neo-hookean"])
def test_steps_are_the_judges(material: str) -> None:
    """Strains of a fifth, three steps of two substeps. Left of a first residual are 1e-4 an iteration, squared by Newton's
    method, until a step promises 1e-13 of the potential: places to its root, 3e-7, times what a substep moves."""
    scene = bar(beam__material=material, beam__poisson_ratio=0.4, beam__damping=0.02, method__substeps=2)
    with opened(scene) as simulation:
        position, velocity = shaken(simulation, 0.01, 0.3)
        start(simulation, position, velocity)
        simulation.advance(3)
        got = simulation.state()
    want = reference.simulate(scene, 3, position, velocity)
    moved = np.abs(want[0] - position).max()
    assert moved > 0.01
    np.testing.assert_allclose(got.position, want[0], atol=3e-7 * moved)
    np.testing.assert_allclose(got.velocity, want[1], atol=3e-7 * moved * 120)


def tip(position: np.ndarray, scene: Scene) -> float:
    rest = scene.tetrahedra_set.position
    return float((rest - position)[rest[:, 0] > rest[:, 0].max() - 1e-9, 1].mean())


def test_a_bar_sags_as_its_mesh_says_whatever_its_stiffness() -> None:
    """NUMERICS E2: 60 steps a second, weight in proportion to E, so that the answer is one. Damped by so much that it creeps;
    position-based steps of the same mesh sag 6.6 and 45 times as far with 4 substeps."""
    still = bar((1.0, 0.1, 0.1), gravity__acceleration=0.01, method__dt=1e3)
    rest = still.tetrahedra_set.position
    want = tip(reference.simulate(still, 1, rest, 0 * rest)[0], still)
    for young in (1e5, 1e6, 1e7):
        scene = bar(
            (1.0, 0.1, 0.1), gravity__acceleration=young / 1e7, beam__young_modulus=young, method__iterations=1,
            beam__damping=0.3 * (1e6 / young) ** 0.5,
        )  # fmt: skip
        with opened(scene) as simulation:
            simulation.advance(round(1500 * (1e5 / young) ** 0.5))
            assert tip(simulation.read("position"), scene) == pytest.approx(want, rel=2e-4), young


@pytest.mark.parametrize("way", ["flat", "inverted", "random"])
def test_a_cube_recovers(way: str) -> None:
    """NUMERICS B21: fixed corotated, nu 0.3, flattened, mirrored, vertices anywhere: J > 0 everywhere within 2 s. The
    damper is weak: one in Green's strain grows with the fourth power of a stretch, and holds what is far out of shape."""
    scene = bar((0.3, 0.3, 0.3), beam__pinned=[], beam__damping=0.005, method__iterations=1, **STILL)
    with opened(scene) as simulation:
        position = simulation.state().position
        if way == "random":
            position = 0.3 * np.random.default_rng(5).random(position.shape)
        else:
            position[:, 1] *= 0.0 if way == "flat" else -1.0
        start(simulation, position)
        simulation.advance(120)
        ratio = np.linalg.det(deformation(scene.tetrahedra_set, simulation.read("position")))
    np.testing.assert_allclose(ratio, 1, atol=0.02)


def test_momenta_of_a_free_body() -> None:
    """The momentum stays, but for what conjugate gradients leave. Forces at a step's end have no moment about its places, so
    that implicit Euler's spin changes by h sum m v' x v, v' the new velocities, which for a turn by w h is (w h)^2 of it."""
    h = 1 / 60
    scene = bar(beam__pinned=[], beam__damping=1e-9, **STILL)
    mass = scene.tetrahedra_set.masses[:, None]
    with opened(scene) as simulation:
        position, velocity = shaken(simulation, 0.005, 0.3)
        velocity += np.cross([0.0, 0.0, 3.0], position - position.mean(axis=0))
        start(simulation, position, velocity)
        state = simulation.state()
        scale = float((mass * np.abs(velocity)).sum())
        momentum = (mass * velocity).sum(axis=0)
        for _ in range(30):
            last = state
            simulation.advance(1)
            state = simulation.state()
            spins = [np.cross(one.position, mass * one.velocity).sum(axis=0) for one in (last, state)]
            loss = h * np.cross(mass * state.velocity, last.velocity).sum(axis=0)
            np.testing.assert_allclose(spins[1] - spins[0], loss, atol=1e-6 * scale)
    np.testing.assert_allclose((mass * state.velocity).sum(axis=0), momentum, atol=1e-6 * scale)


def test_single_precision_stays_at_rest_and_sags_as_far() -> None:
    still = bar((1.0, 0.1, 0.1), gravity__acceleration=0.01, method__dt=1e3)
    rest = still.tetrahedra_set.position
    want = tip(reference.simulate(still, 1, rest, 0 * rest)[0], still)
    young = 1e7
    scene = bar(
        (1.0, 0.1, 0.1), gravity__acceleration=1.0, beam__young_modulus=young, beam__damping=0.1, method__iterations=1
    )  # fmt: skip
    with opened(scene, "float32") as simulation:
        simulation.advance(200)
        assert tip(simulation.read("position").astype(float), scene) == pytest.approx(want, rel=2e-3)
        assert np.abs(simulation.state().velocity).max() < 1e-4


@pytest.mark.parametrize("young", [1e5, 1e7])
def test_what_falls_on_a_floor_comes_to_rest_on_it(young: float, tmp_path: Path) -> None:
    """Colliders push while a step is solved: pushed out afterwards alone, a stiff body would be strained by as much as it
    falls in a step, and thrown back."""
    table = (
        f"[a]\nkind = 'tetrahedral_body'\nshape = {{ name = 'box', sides = [0.3, 0.2, 0.2] }}\norigin = [0.0, 0.3, 0.0]\n"
        f"edge = 0.1\nangle = 20.0\naxis = [0.0, 0.0, 1.0]\nyoung_modulus = {young}\ndamping = 0.01\n"
        "[floor]\nkind = 'plane'\nstatic_friction = 0.6\ndynamic_friction = 0.5\n[gravity]\n"
        "[method]\nsolver = 'newton'\ndt = 0.016666666666666666\niterations = 3\n"
    )
    (tmp_path / "fall.toml").write_text(table, encoding="utf-8")
    scene = load_scene(tmp_path / "fall.toml")
    with opened(scene) as simulation:
        fastest = 0.0
        for _ in range(12):
            simulation.advance(15)
            state = simulation.state()
            fastest = max(fastest, float(np.abs(state.velocity).max()))
            assert state.position[:, 1].min() >= 0
        ratio = np.linalg.det(deformation(scene.tetrahedra_set, state.position))
    assert fastest < 4 and np.abs(state.velocity).max() < 1e-3
    np.testing.assert_allclose(ratio, 1, atol=0.05)


def test_rows_of_blocks_hold_each_corner_pair_once() -> None:
    scene = bar((0.3, 0.2, 0.1))
    corners, particles = scene.tetrahedra_set.tetrahedra, scene.tetrahedra_set.particle_count
    rows = block_rows(corners, particles)
    random = np.random.default_rng(0)
    blocks = random.normal(size=(len(corners), 10, 3, 3))
    whole = np.zeros((particles, particles, 3, 3))
    place = 0
    for p in range(4):
        for q in range(p, 4):
            for n, cell in enumerate(corners):
                whole[cell[p], cell[q]] += blocks[n, place]
                if p != q:
                    whole[cell[q], cell[p]] += blocks[n, place].T
            place += 1
    flat = blocks.reshape(-1, 3, 3)
    for k in range(particles):
        assert rows.columns[rows.diagonal[k]] == k
        for n in range(rows.starts[k], rows.starts[k + 1]):
            found = sum(
                (flat[item >> 1].T if item & 1 else flat[item >> 1])
                for item in rows.items[rows.sources[n] : rows.sources[n + 1]]
            )
            np.testing.assert_allclose(found, whole[k, rows.columns[n]], atol=1e-12)
    meets = [rows.corners[rows.corner_starts[k] : rows.corner_starts[k + 1]] for k in range(particles)]
    assert all((corners.ravel()[one] == k).all() for k, one in enumerate(meets)) and len(rows.corners) == corners.size
