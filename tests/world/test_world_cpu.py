"""Worlds of several families on CPU threads: against the NumPy reference, against members by themselves, laws."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from world_scenes import BY_VERTICES, METHOD, moving, world_scene

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

STEPS = 3


def run(scene: Scene, steps: int = STEPS, begin: State | None = None, **options: Any) -> State:
    options = {"precision": "float64", "math": "exact", "threads": 1} | options
    with open_simulation(scene, "cpu", initial=begin or moving(scene), **options) as simulation:
        simulation.advance(steps)
        return simulation.state()


@pytest.mark.parametrize("name,precision", [("all", "float64"), ("all", "float32"), (BY_VERTICES, "float64")])
def test_members_that_nothing_couples_move_as_each_alone(name: str, precision: str) -> None:
    """To the bit, whichever kernel steps a member that is alone."""
    scene = world_scene(name, contact=None)
    begin = moving(scene)
    state = run(scene, begin=begin, precision=precision)
    for name, place in scene.world_set.slices().items():
        part = State(begin.position[place], begin.velocity[place], begin.inverse_mass[place], 0.0, 0)
        alone = run(scene.members[name], begin=part, precision=precision)
        assert alone.position.tobytes() == state.position[place].tobytes(), name
        assert alone.velocity.tobytes() == state.velocity[place].tobytes(), name


def test_momentum_is_kept() -> None:
    """A block and a jelly that collide in flight: what a contact gives to one it takes from the other, so that the sum of m v
    changes by rounding alone, that of 60 substeps of some hundred sums of a momentum of 1 kg m/s."""
    scene = world_scene("jelly on a block", gravity=None)
    m, begin = scene.world_set.masses[:, None], moving(scene)
    end = run(scene, 20, begin=begin)
    scale = float((m * np.abs(begin.velocity)).sum())
    np.testing.assert_allclose((m * end.velocity).sum(axis=0), (m * begin.velocity).sum(axis=0), atol=1e-11 * scale)
    block = scene.world_set.slices()["tetrahedra"]
    given = (m * (end.velocity - begin.velocity))[block].sum(axis=0)
    assert given[1] < -0.1 * scale  # they met


def test_tetrahedra_by_vertices_give_what_they_take() -> None:
    """As above, but for what sweeps leave undone of the body's own forces, which is a force on all of it: the less, the more
    there are, half with twice as many, since contacts move vertices after the last one, too. Were a contact's push not added
    to where inertia takes a vertex, each sweep would take it back, and the jelly would get many times what is given."""
    lost = []
    for iterations in (4, 16):
        method = METHOD | {"tetrahedra": "vbd", "iterations": iterations}
        scene = world_scene(BY_VERTICES, gravity=None, method=method)
        m, begin = scene.world_set.masses[:, None], moving(scene)
        change = m * (run(scene, 20, begin=begin).velocity - begin.velocity)
        given = change[scene.world_set.slices()["tetrahedra"]].sum(axis=0)
        assert given[1] < -0.1 * float((m * np.abs(begin.velocity)).sum())
        lost.append(float(np.abs(change.sum(axis=0)).max() / np.abs(given).max()))
    assert lost[0] < 2e-3 and lost[1] < 0.5 * lost[0]


def momentum(scene: Scene, state: State, member: str) -> np.ndarray:
    """[kg m/s]"""
    place = scene.world_set.slices()[member]
    found: np.ndarray = (scene.world_set.masses[:, None] * state.velocity)[place].sum(axis=0)
    return found


@pytest.mark.parametrize("member", ["bodies", "tetrahedra"])
def test_a_poke_pushes_its_particle_and_the_member_that_it_is_of(member: str) -> None:
    """In a step of dt by F dt, to rounding; nothing of the other member."""
    scene = world_scene("jelly on a block", gravity=None, contact=None)
    particle = scene.world_set.slices()[member].start + 3
    options: dict[str, Any] = {"precision": "float64", "math": "exact", "threads": 1, "live": ("poke",)}
    with open_simulation(scene, "cpu", **options) as simulation:
        begin = simulation.state()
        simulation.poke(particle, (1.0, -2.0, 0.5))
        simulation.advance(1)
        end = simulation.state()
        for name in scene.members:
            given = momentum(scene, end, name) - momentum(scene, begin, name)
            force = np.array([1.0, -2.0, 0.5]) * (name == member)
            np.testing.assert_allclose(given, force * scene.method.dt, atol=1e-12)
        if member == "tetrahedra":  # whose sweeps hand little of it on in a step
            assert np.abs(end.velocity - begin.velocity).max(axis=1).argmax() == particle


def test_a_bad_particle_is_told_by_its_number_in_the_world() -> None:
    scene = world_scene("jelly on a block")
    bad = list(scene.world_set.slices().values())[1].start + 3
    with open_simulation(scene, "cpu", threads=1) as simulation:
        position, velocity = simulation._download()
        position[bad] = np.nan
        simulation._upload(position, velocity)
        assert simulation._first_diverged() == bad


def test_gravity_is_live_for_all_members() -> None:
    """Switched off, nothing falls; members fly on as each alone does."""
    scene = world_scene("jelly on a block", contact=None)
    options: dict[str, Any] = {"precision": "float64", "math": "exact", "threads": 1, "live": ("gravity",)}
    with open_simulation(scene, "cpu", **options) as simulation:
        begin = simulation.state()
        simulation.set("gravity.enabled", False)
        simulation.advance(2)
        for name in scene.members:
            np.testing.assert_allclose(
                momentum(scene, simulation.state(), name), momentum(scene, begin, name), atol=1e-12
            )
        simulation.set("gravity.enabled", True)
        simulation.advance(1)
        fallen = momentum(scene, simulation.state(), "bodies") - momentum(scene, begin, "bodies")
        mass = scene.world_set.masses[scene.world_set.slices()["bodies"]].sum()
        assert fallen[1] == pytest.approx(-9.81 * scene.method.dt * mass, rel=1e-9)


def test_energies_are_the_members() -> None:
    scene = world_scene("all")
    state = run(scene)
    with open_simulation(scene, "cpu", initial=state, precision="float64", math="exact", threads=1) as simulation:
        whole = simulation.energies()
        each = [member.energies() for member in simulation.members.values()]  # type: ignore[attr-defined]
    for name in ("kinetic", "spring", "gravity", "total", "conserved"):
        assert whole[name] == pytest.approx(sum(one[name] for one in each), rel=1e-12)
    assert whole["spring"] > 0 and "structural" in whole
