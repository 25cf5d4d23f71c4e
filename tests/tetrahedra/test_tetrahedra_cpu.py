"""Tetrahedral bodies on CPU threads: against the NumPy reference, kernels and threads against one another, what must hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tetrahedra_scenes import BODY, FREE, PARTS, moving, tetrahedra_scene

from softlab.app.driver import open_simulation
from softlab.app.output.pieces import pieces_of
from softlab.bench.reference import tetrahedra as reference
from softlab.bench.reference import tetrahedra_voxels as voxel_reference
from softlab.bench.reference.finite_elements import Body
from softlab.model.base.variant import plain_formulas
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.formulas.constraints.tetrahedron import MATERIALS
from softlab.model.formulas.elastic import deformation
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import constraint_sets, tetrahedra_of_sets
from softlab.model.tetrahedra.material import deformation as gradient_of
from softlab.model.tetrahedra.material import energies, stretches

STEPS = 2


def run(scene: Scene, steps: int = STEPS, **options: Any) -> State:
    options = {"precision": "float64", "math": "exact", "threads": 1} | options
    with open_simulation(scene, "cpu", initial=moving(scene), **options) as simulation:
        simulation.advance(steps)
        return simulation.state()


@pytest.mark.parametrize("name", [name for name in PARTS if "everything" not in name and "voxels" not in name])
def test_states_are_the_references(name: str) -> None:
    """Both in float64: what differs is the order of operations, so rounding alone, 2^-53 times some thousand operations on
    lengths of 0.3 m, which projections magnify by no more than their stiffness over that of inertia, E h^2 / (rho l^2) = 20:
    1e-12 m; velocities 1/h = 300 times that."""
    scene = tetrahedra_scene(name)
    found, part, begin = scene.tetrahedra_set, scene.tetrahedra["body"], moving(scene)
    (rows,), (chosen,) = constraint_sets(scene), tetrahedra_of_sets(found)
    body = Body.of(found.position, found.tetrahedra[chosen], part.material, part.young_modulus, part.poisson_ratio)
    method = scene.method
    position, velocity = reference.simulate(
        body, begin.position, begin.velocity, begin.inverse_mass, method.dt, method.substeps, STEPS,
        reference.Method(
            rows.sweep, method.iterations, (0.0, -9.81, 0.0), part.damping,
            scheme="blocks" if method.rows == "blocks" else "rows",
        ),
    )  # fmt: skip
    state = run(scene)
    np.testing.assert_allclose(state.position, position, atol=1e-12)
    np.testing.assert_allclose(state.velocity, velocity, atol=3e-10)
    assert np.abs(state.position - begin.position).max() > 1e-3  # something happened


def test_a_moved_and_turned_body_is_at_rest() -> None:
    """A rigid motion strains nothing: without a velocity nothing moves but by rounding."""
    scene = Scene({"body": FREE | {"angle": 73.0, "axis": [1.0, 2.0, -1.0], "velocity": [0.0] * 3, "spin": [0.0] * 3}})
    body = build(scene)
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(2)
        np.testing.assert_allclose(simulation.state().position, body.position, atol=1e-14)
        assert simulation.energies()["spring"] == pytest.approx(0, abs=1e-20)


@pytest.mark.parametrize("name", ["fixed-corotated", "corotated", "neo-hookean"])
def test_energies_are_the_judges(name: str) -> None:
    scene = tetrahedra_scene(name)
    found, part, position = scene.tetrahedra_set, scene.tetrahedra["body"], moving(scene, 0.03).position
    body = Body.of(found.position, found.tetrahedra, part.material, part.young_modulus, part.poisson_ratio)
    rest = body.energy(found.position)  # the judge's neo-Hookean one need not be 0 there
    assert energies(found, position).sum() == pytest.approx(body.energy(position) - rest, rel=1e-12)
    assert energies(found, found.position).sum() == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("volume", ["tetrahedra", "voxels"])
def test_cut_voxels_are_the_references_with_a_fraction_of_the_stiffness(volume: str) -> None:
    """A ball in voxels of 1/3 of it: the reference's stiffness of each tetrahedron is that of its part inside."""
    ball = {
        "kind": "tetrahedral_body",
        "shape": {"name": "ball", "resolution": 8, "scale": 0.3},
        "voxels": 3,
        "volume": volume,
    }
    method = {"solver": "xpbd", "dt": 1 / 300, "substeps": 1, "iterations": 1}
    scene = Scene({"body": ball | {"young_modulus": 1e4, "poisson_ratio": 0.3}, "gravity": {}, "method": method})
    found, part, begin = scene.tetrahedra_set, scene.tetrahedra["body"], moving(scene, 0.01)
    sets, (chosen, *first) = constraint_sets(scene), tetrahedra_of_sets(found)
    young = part.young_modulus * found.fraction[chosen]
    body = Body.of(found.position, found.tetrahedra[chosen], part.material, young, part.poisson_ratio)
    common = body, begin.position, begin.velocity, begin.inverse_mass
    stepped = reference.Method(sets[0].sweep, gravity=(0.0, -9.81, 0.0))
    if volume == "voxels":
        place = np.empty(len(chosen), np.int64)
        place[chosen] = np.arange(len(chosen))
        members = [np.sort(place[np.flatnonzero(found.patch == found.patch[one])]) for one in first[0]]
        position, _ = voxel_reference.simulate(*common, members, method["dt"], STEPS, stepped)
    else:
        position, _ = reference.simulate(*common, method["dt"], 1, STEPS, stepped)
    assert 0.01 < found.fraction.min() + 0.01 < found.fraction.max() and (found.fraction < 1).any()
    np.testing.assert_allclose(run(scene).position, position, atol=1e-11)
    assert np.abs(position - begin.position).max() > 1e-3


@pytest.mark.parametrize("solver", ["xpbd", "vbd"])
@pytest.mark.parametrize("how", ["flat", "inside out", "scattered"])
@pytest.mark.parametrize("material", MATERIALS)
def test_b21_a_body_out_of_all_shape_recovers(how: str, material: str, solver: str) -> None:
    """Within 2 s, damped, every tetrahedron has its volume's sign again; nothing ever is not finite."""
    many = {"xpbd": {"substeps": 20, "iterations": 1}, "vbd": {"substeps": 1, "iterations": 20}}[solver]
    scene = Scene({
        "body": BODY | {"pinned": [], "material": material, "damping": 0.01, "poisson_ratio": 0.3},
        "method": {"solver": solver, "dt": 1 / 60} | many, "damping": {"coefficient": 0.05},
    } | ({"gravity": {}} if solver == "vbd" else {}))  # fmt: skip
    body = build(scene)
    position = body.position.copy()
    if how == "flat":
        position[:, 1] = 0.0
    elif how == "inside out":
        position[:, 1] *= -0.5
    else:
        position = np.random.default_rng(1).uniform(-0.1, 0.1, position.shape)
    begin = State(position, np.zeros_like(position), body.inverse_mass, 0.0, 0)
    with open_simulation(scene, "cpu", initial=begin, precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(120)
        gradient = gradient_of(scene.tetrahedra_set, simulation.state().position)
    assert np.linalg.det(gradient).min() > 0
    assert np.abs(stretches(gradient) - 1).max() < 0.2


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_the_rotation_is_the_nearest(real: type) -> None:
    """The largest trace of R'F that a rotation has: the sum of the singular values, the smallest with the sign of det F; R is
    one to rounding. Of any F: sheared, mirrored, flat, nothing."""
    rotation, random = plain_formulas(deformation, real).rotation, np.random.default_rng(0)
    eps = float(np.finfo(real).eps)
    matrices = [random.normal(size=(3, 3)) for _ in range(200)]
    matrices += [np.eye(3) + 0.2 * random.normal(size=(3, 3)) for _ in range(200)]
    matrices += [
        np.zeros((3, 3)),
        np.diag([1.0, 1, 0]),
        np.diag([1.0, 0, 0]),
        -np.diag([3.0, 2, 1]),
        np.diag([1, 1, -0.5]),
    ]
    matrices += [scale * matrices[0] for scale in (1e-12, 1e12)]
    for matrix in matrices:
        f = matrix.astype(real)
        r = np.array(rotation(tuple(f.ravel())), float).reshape(3, 3)
        s = stretches(f.astype(float)[None])[0]
        assert np.abs(r.T @ r - np.eye(3)).max() < 10 * eps
        assert np.linalg.det(r) > 0
        assert np.trace(r.T @ f.astype(float)) >= s.sum() - 100 * eps * np.abs(s).max()


def test_every_material_is_in_the_parts() -> None:
    assert {part.material for scene in map(tetrahedra_scene, PARTS) for part in scene.tetrahedra.values()} == {
        "fixed-corotated", "corotated", "neo-hookean",
    }  # fmt: skip


def test_skins_are_what_other_programs_get() -> None:
    """A piece a body, closed, where its tetrahedra carry it: moved by what moves all particles."""
    scene = tetrahedra_scene("everything")
    found = scene.tetrahedra_set
    still, moved = (pieces_of(scene, found.position + way) for way in (0.0, np.array([0.1, -0.2, 0.3])))
    assert [piece.name for piece in still] == ["body", "second", "third"]
    for before, after in zip(still, moved, strict=True):
        np.testing.assert_allclose(
            after.vertices - before.vertices, np.tile([0.1, -0.2, 0.3], (len(before.vertices), 1))
        )
        assert before.triangles is not None and before.normals is not None
        edges = np.sort(before.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}
