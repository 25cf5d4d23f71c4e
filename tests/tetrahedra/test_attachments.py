"""Attachments of tetrahedral bodies: to the world, to colliders that move, to one another; against laws and closed forms."""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np
import pytest
from kinematic_scenes import BAR, CUBE, HOOK, LOOSE, SOLVERS, kinematic_scene, run
from vbd_scenes import elastic_force

from softlab.app.driver import open_simulation
from softlab.model.base.errors import InputError, SceneError
from softlab.model.contact.attachments import attachment_sets, contact_free
from softlab.model.contact.surface_parameters import contact_surface
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.springs import springs, supported_particles

DT = 0.01

EXACT: dict[str, Any] = {"precision": "float64", "math": "exact", "threads": 1}
CLAMP: dict[str, Any] = {"kind": "attachment", "body": "bar", "vertices": "left"}
LEAST = {"newton": 20, "vbd": 400}  # of iterations, until nothing moves
PLATE = {"kind": "box", "center": [-0.18, 0.0, 0.0], "half_size": [0.02, 0.1, 0.1], "velocity": [0.1, 0.3, 0.0]}


def test_two_free_bodies_that_are_attached_keep_their_momentum() -> None:
    """Weights add up to 1, so that the sum of m v changes by rounding alone; and they stay together as far as sweeps go."""
    scene = kinematic_scene("xpbd", bar=LOOSE, cube=CUBE, hook=HOOK)
    found = scene.tetrahedra_set
    state = run(scene, 50, **EXACT)
    first, last = ((found.masses[:, None] * v).sum(axis=0) for v in (found.velocity, state.velocity))
    scale = float((found.masses[:, None] * np.abs(found.velocity)).sum())
    np.testing.assert_allclose(last, first, atol=1e-13 * scale)
    (one,) = attachment_sets(found)
    corners = state.position[one.corners]
    apart = corners[:, 0] - np.einsum("nk,nki->ni", one.values[:, :4], corners[:, 1:])
    assert np.abs(apart).max() < 1e-4 and np.abs(state.position - found.position).max() > 0.05


def test_a_body_on_soft_attachments_hangs_as_low_as_they_give() -> None:
    """n vertices of a compliance each bear the weight: on average they are lower by g m compliance / n."""
    given = 1e-3
    scene = kinematic_scene(
        "xpbd", bar=LOOSE | {"young_modulus": 2e5, "damping": 0.1}, gravity={}, damping={"coefficient": 0.1},
        clamp=CLAMP | {"vertices": "top", "compliance": given},
        method={"solver": "xpbd", "dt": 0.01, "substeps": 20, "iterations": 1},
    )  # fmt: skip
    found = scene.tetrahedra_set
    at = found.chosen("top")
    state = run(scene, 300, **EXACT)
    lower = float((found.position[at, 1] - state.position[at, 1]).mean())
    assert lower == pytest.approx(9.81 * float(found.masses.sum()) * given / len(at), rel=1e-3)


def pulls(scene: Scene, position: np.ndarray) -> np.ndarray:
    """(particles, 3) [N]: the derivative of what springs hold at `position`, from the attachments themselves; one that gives
    nothing is as hard as the model says."""
    found = scene.tetrahedra_set
    hard, place, force = springs(found, scene.method.solver).values[:, -1], 0, np.zeros_like(position)
    for one in attachment_sets(found):
        many, compliance = len(one.corners), one.values[:, -1]
        stiff, place = hard[place : place + many], place + many
        gives = compliance > 0
        np.testing.assert_allclose(stiff[gives], 1 / compliance[gives])
        weights, there = np.ones((many, 1)), one.values[:, :3]
        if one.model == "bodies":
            weights, there = np.column_stack([weights, -one.values[:, :4]]), np.zeros((many, 3))
        apart = np.einsum("nk,nki->ni", weights, position[one.corners]) - there
        np.add.at(force, one.corners, stiff[:, None, None] * weights[:, :, None] * apart[:, None, :])
    return force


@pytest.mark.parametrize("compliance", [0.0, 1e-3])
@pytest.mark.parametrize("solver", LEAST)
def test_a_step_is_backward_eulers(solver: str, compliance: float) -> None:
    """The derivative of all that a step makes least is nothing where it ends, but for a millionth of the weight."""
    scene = kinematic_scene(
        solver, bar=LOOSE | {"edge": 0.1}, cube=CUBE | {"edge": 0.1}, hook=HOOK | {"compliance": compliance}, gravity={},
        clamp=CLAMP | {"compliance": 1e-4}, method={"solver": solver, "dt": DT, "iterations": LEAST[solver]},
    )  # fmt: skip
    found, state = scene.tetrahedra_set, run(scene, 1, **EXACT)
    mass = found.masses[:, None]
    target = found.position + DT * found.velocity - DT**2 * np.array([0.0, 9.81, 0.0])
    slope = mass * (state.position - target) / DT**2 - elastic_force(found, state.position)
    slope += pulls(scene, state.position)
    assert np.abs(slope).max() < 1e-6 * 9.81 * mass.sum()


@pytest.mark.parametrize("solver", LEAST)
def test_momentum_stays_where_bodies_hold_each_other(solver: str) -> None:
    """As far as iterations go, which for sweeps is to a thousandth."""
    scene = kinematic_scene(
        solver, bar=LOOSE | {"edge": 0.1}, cube=CUBE | {"edge": 0.1}, hook=HOOK,
        method={"solver": solver, "dt": DT, "iterations": LEAST[solver] // 10},
    )  # fmt: skip
    found, state = scene.tetrahedra_set, run(scene, 5, **EXACT)
    first, last = ((found.masses[:, None] * v).sum(axis=0) for v in (found.velocity, state.velocity))
    scale = float((found.masses[:, None] * np.abs(found.velocity)).sum())
    np.testing.assert_allclose(last, first, atol=(1e-3 if solver == "vbd" else 1e-6) * scale)


@pytest.mark.parametrize("solver", LEAST)
def test_who_hangs_from_another_rests_where_both_are_held(solver: str) -> None:
    """A cube under a bar whose ends are pinned, at once where it ends: nothing of a joint's gap is of a pixel's size."""
    scene = kinematic_scene(
        solver, bar=BAR | {"edge": 0.1, "damping": 0.1}, cube=LOOSE | {
            "shape": CUBE["shape"], "edge": 0.1, "origin": [0.0, -0.1, 0.0], "damping": 0.1,
        }, hook=HOOK, gravity={}, method={"solver": solver, "dt": 0.05, "iterations": LEAST[solver] // 10},
    )  # fmt: skip
    found, state = scene.tetrahedra_set, run(scene, 60, **EXACT)
    (one,) = attachment_sets(found)
    corners = state.position[one.corners]
    apart = corners[:, 0] - np.einsum("nk,nki->ni", one.values[:, :4], corners[:, 1:])
    force = elastic_force(found, state.position) - pulls(scene, state.position)
    weight = 9.81 * float(found.masses.sum())
    np.testing.assert_allclose(force[found.pinned_vertices].sum(axis=0)[1], -weight + 9.81 * float(
        found.masses[found.pinned_vertices].sum()), rtol=1e-3)  # fmt: skip
    assert np.abs(apart).max() < 2e-3 and np.abs(state.velocity).max() < 1e-3


def test_who_hangs_from_a_body_with_pins_does_not_fall() -> None:
    held, free = (
        supported_particles(kinematic_scene("vbd", bar=bar, cube=CUBE, hook=HOOK).tetrahedra_set)
        for bar in (BAR, LOOSE)
    )
    assert held.all() and not free.any()


def test_a_vertex_is_drawn_to_a_point() -> None:
    """All vertices, without gravity: the body comes to lie about the point."""
    scene = kinematic_scene(
        "xpbd", bar=LOOSE, damping={"coefficient": 0.4},
        clamp=CLAMP | {"vertices": "all", "compliance": 1.0, "point": [1.0, 2.0, 3.0]},
    )  # fmt: skip
    state = run(scene, 300, **EXACT)
    np.testing.assert_allclose(state.position.mean(axis=0), [1.0, 2.0, 3.0], atol=0.02)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_side_goes_with_a_plate_and_one_without_stays(solver: str) -> None:
    scene = kinematic_scene(
        solver, bar=LOOSE, plate=PLATE, to_plate=CLAMP | {"to": "plate"}, to_world=CLAMP | {"vertices": "right"}
    )
    found = scene.tetrahedra_set
    left, right = found.chosen("left"), found.chosen("right")
    state = run(scene, 10, **EXACT)
    np.testing.assert_allclose(state.position[left], found.position[left] + [0.01, 0.03, 0.0], atol=1e-15)
    np.testing.assert_allclose(state.velocity[left], np.tile(PLATE["velocity"], (len(left), 1)), atol=1e-15)
    assert np.array_equal(state.position[right], found.position[right]) and not state.velocity[right].any()


def test_a_side_turns_with_a_mesh_that_spins() -> None:
    wheel = {
        "kind": "mesh_collider", "shape": {"name": "torus"}, "origin": [-0.6, 0.0, 0.0], "spin": [0.0, 0.0, 2.0],
        "velocity": [0.0, 0.5, 0.0],
    }  # fmt: skip
    scene = kinematic_scene("xpbd", bar=LOOSE, wheel=wheel, clamp=CLAMP | {"to": "wheel"})
    found = scene.tetrahedra_set
    left = found.chosen("left")
    state = run(scene, 20, **EXACT)
    c, s = cos(0.4), sin(0.4)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    place = (found.position[left] - wheel["origin"]) @ turn.T + wheel["origin"] + [0.0, 0.1, 0.0]
    np.testing.assert_allclose(state.position[left], place, atol=1e-14)


def test_contacts_are_told_whom_to_leave_alone() -> None:
    scene = kinematic_scene("xpbd", bar=LOOSE, cube=CUBE, hook=HOOK)
    found = scene.tetrahedra_set
    free = contact_free(found)
    assert free[found.chosen("top", "cube")].all() and not free[found.chosen("bottom", "cube")].any()
    (one,) = attachment_sets(found)
    assert free[one.corners].all() and not free[found.chosen("left", "bar")].any()


def test_surfaces_that_an_attachment_holds_together_do_not_push_each_other_away() -> None:
    """The cube's top lies in the bar's bottom: but for the joint nothing is near, so that contacts change nothing."""
    parts: dict[str, Any] = {"bar": LOOSE, "cube": CUBE, "hook": HOOK}
    scene = kinematic_scene("xpbd", **parts, contact={"distance": 0.01})
    surface, free = contact_surface(scene.tetrahedra_set), contact_free(scene.tetrahedra_set)
    assert not free[surface.vertices].any() and not free[surface.triangles].any()
    assert (~free[scene.tetrahedra_set.surface]).all(axis=1).sum() == len(surface.triangles) > 0
    with_contacts, without = run(scene, 5, **EXACT), run(kinematic_scene("xpbd", **parts), 5, **EXACT)
    assert with_contacts.position.tobytes() == without.position.tobytes()
    unheld = kinematic_scene("xpbd", bar=LOOSE, cube=CUBE)
    assert run(unheld.replace({"contact.distance": 0.01}), 5, **EXACT).position.tobytes() != (
        run(unheld, 5, **EXACT).position.tobytes()
    )


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"clamp": CLAMP | {"body": "bat"}}, r"clamp.body = 'bat': must be a tetrahedral body.*did you mean bar"),
        ({"clamp": CLAMP | {"to": "plate"}}, r"clamp.to = 'plate': must be a collider .* leave it out for the world"),
        ({"clamp": CLAMP | {"to": "plat"}, "plate": PLATE}, "did you mean plate"),
        ({"clamp": CLAMP | {"to": "bar"}}, "something else than the body itself"),
        ({"clamp": CLAMP | {"vertices": "lift"}}, r"clamp.vertices = 'lift'.*did you mean left"),
        ({"clamp": CLAMP | {"point": [0.0] * 3}}, "clamp.point.*: applies to an attachment to the world"),
        ({"clamp": CLAMP | {"to": "plate", "compliance": 1.0}, "plate": PLATE}, "must be 0, since plate moves"),
        ({"clamp": CLAMP | {"compliance": -1.0}}, "must be at least 0"),
        ({"cube": CUBE | {"origin": [0.0, -1.0, 0.0]}, "hook": HOOK}, r"hook.to = 'bar'.*lies 0\.\d+ m outside"),
        (
            {
                "clamp": CLAMP | {"vertices": "there"},
                "there": {"kind": "region", "center": [9.0] * 3, "radius": 0.1},
            },
            "no vertex of bar lies there",
        ),
    ],
)
def test_what_no_attachment_can_be_is_one_clear_line(changes: dict[str, Any], words: str) -> None:
    with pytest.raises((SceneError, InputError), match=words) as caught:
        open_simulation(Scene({"bar": LOOSE} | changes), **EXACT)
    assert "\n" not in str(caught.value)


def test_energy_counts_what_attachments_hold() -> None:
    """One vertex each 0.1 m away, half a square of it over the compliance."""
    scene = kinematic_scene("xpbd", bar=BAR, clamp=CLAMP | {"vertices": "top", "compliance": 0.5})
    found = scene.tetrahedra_set
    with open_simulation(scene, **EXACT) as simulation:
        state = simulation.state()
        state.position[found.chosen("top")] += [0.0, 0.0, 0.1]
        simulation.load(state)
        held = 0.1**2 / 0.5 / 2 * len(found.chosen("top"))
        alone = kinematic_scene("xpbd", bar=BAR)
        with open_simulation(alone, **EXACT) as other:
            other.load(state)
            assert simulation.energies()["spring"] - other.energies()["spring"] == pytest.approx(held)
