"""Vertex block descent on CPU threads: every sweep lowers the energy of a step of backward Euler, to its least; statics;
bits; what it recovers from; what it keeps of momenta."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from vbd_scenes import (
    BODY,
    EVERYTHING,
    FREE,
    elastic_force,
    end_state,
    moving,
    step_energy,
    step_slope,
    vbd_scene,
    zero_of,
)

from softlab.app.driver import open_simulation
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.formulas.constraints.tetrahedron import MATERIALS
from softlab.model.scene.scene import Scene


def still(scene: Scene, position: np.ndarray) -> State:
    """At rest at `position`."""
    return State(position, np.zeros_like(position), build(scene).inverse_mass, 0.0, 0)


@pytest.mark.parametrize("cut", [5, 6])
@pytest.mark.parametrize("material", MATERIALS)
def test_one_vertex_is_where_backward_euler_has_it(material: str, cut: int) -> None:
    """A voxel with one free corner: Newton's method, on energies and stresses of its own. The neo-Hookean energy is a square
    in one vertex, so that one visit is enough; of the others, many visits go there."""
    body = BODY | {"shape": {"name": "box", "sides": [0.1, 0.1, 0.1]}, "material": material, "tetrahedra": cut}
    scene = vbd_scene(body | {"pinned": ["left", "bottom", "front"]}, iterations=1 if material == "neo-hookean" else 60)
    free, begin = build(scene).inverse_mass > 0, moving(scene, 0.03)
    assert free.sum() == 1
    found = zero_of(step_slope(scene, begin), begin.position, free)
    np.testing.assert_allclose(end_state(scene, start=begin).position, found, atol=1e-12)


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("apart", [0.01, 0.1])
def test_every_sweep_lowers_the_energy(material: str, apart: float) -> None:
    """Of the step, from a body a little or wholly out of shape, many of its tetrahedra inside out."""
    scene = vbd_scene(BODY | {"material": material})
    begin = moving(scene, apart)
    energy = step_energy(scene, begin)
    found = [energy(begin.position + scene.method.dt * begin.velocity)]
    for iterations in range(1, 9):
        found.append(energy(end_state(scene.replace({"method.iterations": iterations}), start=begin).position))
    assert (np.diff(found) <= 1e-12 * abs(found[0])).all(), found
    assert found[-1] < 0.9 * found[0]


def test_a_stretched_corotated_body_goes_down_too() -> None:
    """Pulled to 1.6 times its size in all directions, nearly incompressible: the curvature is what turning makes of it."""
    body = BODY | {"material": "corotated", "poisson_ratio": 0.49, "pinned": ["left", "right"], "edge": 0.05}
    scene = vbd_scene(body | {"shape": {"name": "box", "sides": [0.1, 0.1, 0.1]}}, gravity=0.0, dt=1.0)
    begin = still(scene, 1.6 * moving(scene, 0.001).position)
    energy = step_energy(scene, begin)
    found = [energy(begin.position)]
    for iterations in (1, 2, 3, 6, 12):
        found.append(energy(end_state(scene.replace({"method.iterations": iterations}), start=begin).position))
    assert (np.diff(found) <= 1e-12 * abs(found[0])).all(), found


@pytest.mark.parametrize("body", [BODY, FREE])
def test_many_sweeps_are_a_step_of_backward_euler(body: dict[str, Any]) -> None:
    """Forces left fall to rounding; so the answer is the one, whatever the start and the order of the colours."""
    scene = vbd_scene(body, iterations=60)
    begin = moving(scene)
    slope = step_slope(scene, begin)
    scale = np.abs(slope(begin.position + scene.method.dt * begin.velocity)).max()
    few = end_state(scene.replace({"method.iterations": 12}), start=begin)
    state = end_state(scene, start=begin)
    assert np.abs(slope(few.position)).max() < 1e-2 * scale
    assert np.abs(slope(state.position)).max() < 1e-9 * scale
    np.testing.assert_allclose(state.velocity, (state.position - begin.position) / scene.method.dt, atol=1e-12)


def static(scene: Scene) -> np.ndarray:
    """(particles, 3) [m]: where a pinned body is at rest under its weight."""
    found, body = scene.tetrahedra_set, build(scene)
    free = body.inverse_mass > 0
    weight = found.masses[:, None] * np.array([0.0, -9.81, 0.0])
    return zero_of(lambda x: -1.0 * free[:, None] * (elastic_force(found, x) + weight), found.position, free)


def test_at_rest_no_number_of_iterations_moves_it() -> None:
    """The static answer of the mesh, by a Newton's method of the test's own: one sweep a step leaves it where it is."""
    scene = vbd_scene(iterations=1)
    rest = static(scene)
    assert np.abs(rest - scene.tetrahedra_set.position).max() > 1e-3
    state = end_state(scene, 5, still(scene, rest))
    np.testing.assert_allclose(state.position, rest, atol=1e-12)


def test_a_cantilever_comes_to_rest_where_its_mesh_says() -> None:
    """From straight on, with few sweeps a step, braked: to the static answer."""
    scene = vbd_scene(BODY | {"damping": 0.02}, iterations=4).replace({"damping.coefficient": 0.5})
    rest = static(scene)
    with open_simulation(scene, precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(400)
        np.testing.assert_allclose(simulation.state().position, rest, atol=1e-6)


def test_float32_is_float64_rounded() -> None:
    scene = Scene(EVERYTHING)
    one, other = end_state(scene, 2), end_state(scene, 2, precision="float32")
    np.testing.assert_allclose(other.position, one.position, atol=2e-5)


def test_momentum_is_kept_as_far_as_sweeps_go() -> None:
    """Only the energy's least, where all forces of a tetrahedron are of one position, keeps momenta: sweep by sweep less is
    missing, and nothing after many."""
    scene = vbd_scene(FREE, gravity=0.0)
    m, begin = scene.tetrahedra_set.masses[:, None], moving(scene)
    scale = (m * np.abs(begin.velocity)).sum()

    def missing(iterations: int) -> float:
        velocity = end_state(scene.replace({"method.iterations": iterations}), start=begin).velocity
        return float(np.abs((m * (velocity - begin.velocity)).sum(axis=0)).max() / scale)

    lost = [missing(iterations) for iterations in (1, 8, 60)]
    assert lost[0] > 1e-4 and lost[1] < 0.3 * lost[0] and lost[2] < 1e-9, lost


def test_b23_one_iteration_is_stable_only_soft() -> None:
    """A stiff beam, poked for a step and let go: its energy never grows beyond what the poke gave, and falls."""
    scene = vbd_scene(BODY | {"young_modulus": 1e7}, gravity=0.0, dt=1 / 60, iterations=1)
    begin = moving(scene, 0.02)
    with open_simulation(scene, initial=begin, precision="float64", math="exact", threads=1) as simulation:
        found = []
        for _ in range(30):
            simulation.advance(1)
            found.append(simulation.energies()["total"])
    assert np.isfinite(found).all() and found[-1] < found[0] and max(found) == found[0]
