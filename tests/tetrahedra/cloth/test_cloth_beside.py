"""A cloth beside tetrahedral bodies: against the NumPy reference, kernels against one another, laws of statics and friction,
what holds the one to the other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from beside_scenes import BOX, METHOD, TIE, crumpled_state, on_cloth, sheet, tied

from softlab.app.driver import open_simulation
from softlab.app.output.pieces import pieces_of
from softlab.app.plan.report import plan_report
from softlab.model.base.errors import InputError, SceneError
from softlab.model.contact.attachments import attachment_sets, contact_free
from softlab.model.contact.surface_parameters import contact_surface
from softlab.model.core.simulation import State
from softlab.model.position_based.mesh_constraints import constraint_sets, mesh_energy
from softlab.model.scene.scene import Scene

EXACT: dict[str, Any] = {"precision": "float64", "math": "exact", "threads": 1}
GRAVITY, STIFFNESS = 9.81, 1000.0  # m/s^2, N/m of the cloth's edges


def run(scene: Scene, steps: int = 2, initial: State | None = None, **options: Any) -> State:
    with open_simulation(scene, "cpu", initial=initial or crumpled_state(scene), **EXACT | options) as simulation:
        simulation.advance(steps)
        if scene.contact:
            contacts: Any = simulation.contacts  # type: ignore[attr-defined]
            assert contacts.lost == contacts.neighbours_lost == 0
        return simulation.state()


# ---------------------------------------------------------------------- laws


def test_momentum_goes_from_the_cloth_to_bodies_and_back() -> None:
    """Nothing is held: contacts, joints and constraints push as much as they are pushed, but for rounding."""
    loose = BOX | {"origin": [-0.05, 0.0, 0.1], "shape": {"name": "box", "sides": [0.1, 0.1, 0.3]}}
    scene = tied(
        box=loose, gravity=None, wind=None, cube=BOX | {"origin": [0.12, 0.058, 0.11], "velocity": [0.2, -1.0, 0.0]}
    )
    m, begin = scene.tetrahedra_set.masses[:, None], crumpled_state(scene)
    state = run(scene, 4, begin)
    scale = float((m * np.abs(begin.velocity)).sum())
    np.testing.assert_allclose((m * state.velocity).sum(axis=0), (m * begin.velocity).sum(axis=0), atol=1e-12 * scale)


def resting(**parts: Any) -> Scene:
    """A light box over a cloth, in steps short enough for a thousandth; so wide that no face that bears it has a pinned
    corner, which would take a part of its weight at once."""
    contact = {"distance": 0.01, "sweeps": 4, "static_friction": 0.5, "dynamic_friction": 0.4}
    box = BOX | {"origin": [0.15, 0.062, 0.15], "density": 200.0}
    own = {
        "box": box, "cloth": sheet(7, 7), "structural": {"stiffness": STIFFNESS}, "contact": contact,
        "damping": {"coefficient": 0.02}, "method": {"solver": "xpbd", "dt": 1 / 60, "substeps": 160},
    }  # fmt: skip
    return on_cloth(**own | parts)


def test_the_weight_of_what_rests_on_a_cloth_arrives_at_its_pins() -> None:
    """The pull of the edges on pinned vertices, by Hooke's law, is the weight of all that is not pinned: to 0.2 %
    down, and to 1 % of it across, the way that vertices go between the projections of one substep (m_total/m h^2 g)."""
    scene = resting()
    found = scene.tetrahedra_set
    start = int(found.first_particle[-1])
    pinned = np.zeros(found.particle_count, bool)
    pinned[found.pinned_vertices] = True
    with open_simulation(scene, "cpu", **EXACT) as simulation:
        simulation.advance(180)
        state = simulation.state()
    own = state.position[start:]
    (edges,) = (rows for rows in constraint_sets(scene) if rows.kind == "structural")
    way = own[edges.corners[:, 1]] - own[edges.corners[:, 0]]
    length = np.linalg.norm(way, axis=1)
    pull = (STIFFNESS * (length - edges.values[:, 0]) / length)[:, None] * way
    force = np.zeros_like(own)
    np.add.at(force, edges.corners[:, 0], pull)
    np.subtract.at(force, edges.corners[:, 1], pull)
    weight = GRAVITY * float(found.masses[~pinned].sum())
    beside = force[pinned[start:]].sum(axis=0) / weight - [0.0, -1.0, 0.0]
    assert (np.abs(beside) < [0.01, 0.002, 0.01]).all(), beside
    assert state.position[:start, 1].min() > own[:, 1].min()  # the box lies on it


def test_a_box_slides_on_a_cloth_by_coulombs_law() -> None:
    """A cloth that is held all over is a floor: from 1 m/s a box is slower by mu g t, and stops."""
    hold = {"kind": "attachment", "body": "cloth", "vertices": "all"}
    box = BOX | {"origin": [0.06, 0.0601, 0.15], "density": 200.0, "velocity": [1.0, 0.0, 0.0], "young_modulus": 1e6}
    scene = resting(box=box, hold=hold, damping=None)
    m, speed = scene.tetrahedra_set.masses, []
    assert len(scene.tetrahedra_set.pinned_vertices) == 49
    with open_simulation(scene, "cpu", **EXACT) as simulation:
        for _ in range(3):
            simulation.advance(4)
            speed.append(
                float(m @ simulation.state().velocity[:, 0] / m[: scene.tetrahedra_set.first_particle[1]].sum())
            )
    assert (speed[0] - speed[2]) / (8 / 60) == pytest.approx(0.4 * GRAVITY, rel=0.1)


# ---------------------------------------------------------------------- joints


def test_attachments_hold_both_ways_and_contacts_leave_them_alone() -> None:
    scene = tied()
    found = scene.tetrahedra_set
    bodies, cloth = attachment_sets(found)
    kinds = [(rows.model, rows.corners.shape[1]) for rows in (bodies, cloth)]
    assert kinds == [("bodies", 5), ("cloth", 4)]
    for rows in (bodies, cloth):  # where they are told to be they lie at the start
        there = np.einsum("nk,nki->ni", rows.values[:, :-1], found.position[rows.corners[:, 1:]])
        np.testing.assert_allclose(there, found.position[rows.corners[:, 0]], atol=1e-15)
    free, surface = contact_free(found), contact_surface(found)
    assert free[bodies.corners].all() and free[cloth.corners].all()
    assert not free[surface.triangles].any() and not free[surface.vertices].any()
    with open_simulation(scene, "cpu", **EXACT) as simulation:
        simulation.advance(6)
        position = simulation.read("position")
    corners = position[bodies.corners]
    apart = corners[:, 0] - np.einsum("nk,nki->ni", bodies.values[:, :4], corners[:, 1:])
    assert np.abs(apart).max() < 1e-3 < np.abs(position - found.position).max()


def test_a_side_of_a_cloth_goes_with_a_plate() -> None:
    plate = {"kind": "box", "center": [0.1, 0.0, -0.05], "half_size": [0.2, 0.1, 0.02], "velocity": [0.1, 0.3, 0.0]}
    clamp = {"kind": "attachment", "body": "cloth", "vertices": "back", "to": "plate"}
    scene = on_cloth(cloth=sheet(pinned="none"), plate=plate, clamp=clamp, contact=None)
    found = scene.tetrahedra_set
    back = found.chosen("back", "cloth")
    assert np.array_equal(back, found.pinned_vertices) and len(back) == 5
    with open_simulation(scene, "cpu", **EXACT) as simulation:
        simulation.advance(4)
        state = simulation.state()
    np.testing.assert_allclose(state.position[back], found.position[back] + [0.004, 0.012, 0.0], atol=1e-15)


# ---------------------------------------------------------------------- what is told of it


def test_energies_and_drawings_count_the_cloth() -> None:
    scene, alone = on_cloth(), on_cloth(cloth=None, structural=None, bending=None)
    state, first = crumpled_state(scene), int(scene.tetrahedra_set.first_particle[-1])
    with open_simulation(scene, "cpu", initial=state, **EXACT) as simulation:
        energies = simulation.energies()
    bodies = State(state.position[:first], state.velocity[:first], state.inverse_mass[:first], 0.0, 0)
    with open_simulation(alone, "cpu", initial=bodies, **EXACT) as simulation:
        less = simulation.energies()
    held = sum(mesh_energy(scene, state.position[first:], kind) for kind in ("structural", "bending"))
    assert held > 0 and energies["spring"] - less["spring"] == pytest.approx(held)
    masses = scene.tetrahedra_set.masses[first:]
    moving = 0.5 * float((masses[:, None] * state.velocity[first:] ** 2).sum())
    assert energies["kinetic"] - less["kinetic"] == pytest.approx(moving)
    box, cloth = pieces_of(scene, state.position)
    assert (box.name, cloth.name) == ("box", "cloth") and cloth.triangles is not None and len(cloth.triangles) == 32
    assert np.array_equal(cloth.vertices, state.position[first:])
    assert str(scene.tetrahedra_set).endswith("of 1 body and a cloth of 32 triangles")


def test_a_plan_tells_of_the_cloth_and_of_what_is_launched() -> None:
    """Its constraints come after the tetrahedra's and before attachments; on CUDA none of it stays on the chip."""
    report = plan_report(tied())
    told = report.as_dict()
    assert (told["bodies"], told["triangles"]) == (3, 56)
    names = [row.stage.name for row in report.rows if row.stage]
    first = [
        next(n for n, name in enumerate(names) if word in name) for word in ("voxels", "edges", "bending", "attachment")
    ]
    assert first == sorted(first)
    assert [one.kernel for one in report.backends if one.name == "gpu"] in ([], ["graph"])


@pytest.mark.parametrize(
    "parts, words",
    [
        (
            {"method": METHOD | {"solver": "vbd"}, "contact": None},
            r"cloth.kind = 'mesh': is supported beside .* by xpbd only",
        ),
        (
            {"method": {"solver": "newton"}, "contact": None},
            "xpbd only, not by newton: scene.replace",
        ),
        ({"cloth": None}, r"structural.kind = 'structural': applies to a cloth; add a table \[mesh\]"),
        (
            {"cloth": None, "structural": None, "bending": None, "wind": {}},
            "wind.kind = 'wind': applies to a cloth; add a table",
        ),
        ({"shear": {"stiffness": 1.0}}, "shear.kind = 'shear': is not supported together with tetrahedral bodies"),
        ({"self_collision": {"thickness": 0.01}}, "is not supported together with tetrahedral bodies"),
        (
            {"tie": TIE | {"body": "sheet"}},
            "tie.body = 'sheet': must be a tetrahedral body or a cloth of the scene: box, cloth",
        ),
        ({"tie": TIE | {"to": "bax"}}, "did you mean box"),
        ({"tie": TIE | {"vertices": "edge"}}, "tie.vertices = 'edge': must be one of left, right"),
        (
            {"tie": TIE, "box": BOX | {"origin": [0.3, 0.3, 0.1]}},
            r"tie.to = 'box': a vertex of cloth lies 0\.\d+ m outside of it; attach vertices that touch it",
        ),
        (
            {"tie": TIE | {"body": "box", "vertices": "top", "to": "cloth"}},
            "a vertex of box lies 0.1.* m outside of it",
        ),
        ({"contact": {"distance": 0.01, "restitution": 0.5}}, "applies to bodies of particles"),
    ],
)
def test_what_does_not_go_together_is_one_clear_line(parts: dict[str, Any], words: str) -> None:
    with pytest.raises((SceneError, InputError), match=words) as caught:
        open_simulation(on_cloth(**parts), **EXACT)
    assert "\n" not in str(caught.value)
