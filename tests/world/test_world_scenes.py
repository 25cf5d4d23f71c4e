"""Tables of worlds: what they are made into, what is refused, each with one clear line; plans and pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from world_scenes import BALL, BLOCK, CLOTH, JELLY, METHOD, moving, world_scene

from softlab.app.driver import open_simulation
from softlab.app.output.export import Exporter, check_export
from softlab.app.plan.report import plan_report
from softlab.app.plan.table import amounts
from softlab.app.render.drawn_springs import drawn_strain
from softlab.model.base.errors import SceneError
from softlab.model.contact.shortfalls import shortfalls
from softlab.model.core.build import build, masses
from softlab.model.core.families import family_of, scene_plan
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.world.meeting import MEMBERS_MEETING, cross_surface, distances_of_groups

NAN = float("nan")


def test_members_are_scenes_of_their_own() -> None:
    scene = world_scene("all")
    assert list(scene.members) == ["bodies", "tetrahedra"] and family_of(scene).name == "world"
    assert [family_of(one).name for one in scene.members.values()] == ["bodies", "tetrahedral body"]
    assert scene.members["tetrahedra"].mesh is not None and scene.mesh is None and not scene.bodies
    for one in scene.members.values():
        assert (one.method.dt, one.method.substeps, one.method.iterations) == (0.01, 3, 2)
        assert Scene(one.as_dict()).canonical() == one.canonical()
    assert list(world_scene("jelly on a cloth").members) == ["bodies", "cloth"]
    assert Scene(scene.as_dict()).canonical() == scene.canonical()
    assert not load_scene("fem-cloth").members and not load_scene("jelly-drop").is_world


def test_particles_are_the_members_one_after_the_other() -> None:
    scene = world_scene("two on a pinned block")
    whole, each = build(scene), [build(one) for one in scene.members.values()]
    for name in ("position", "velocity", "inverse_mass"):
        assert np.array_equal(getattr(whole, name), np.concatenate([getattr(one, name) for one in each]))
    assert np.array_equal(whole.pinned, each[1].pinned + len(each[0].position))
    assert np.array_equal(masses(scene), np.concatenate([masses(one) for one in scene.members.values()]))


def test_only_members_of_different_families_meet() -> None:
    """Balls look for the triangles of tetrahedra and cloth, as far as their radius asks; nobody for their own."""
    scene = world_scene("all")
    found, pairs = cross_surface(scene), MEMBERS_MEETING.pairs(scene)
    meets = pairs[:, :, 0] > 0
    assert (
        found.member.tolist() == [0, 0, 1, 1] and meets.tolist() == [[False, False, True, True]] * 2 + [[False] * 4] * 2
    )
    np.testing.assert_allclose(distances_of_groups(scene), [0.025 + 0.01, 0.025 + 0.01, 0.02, 0.02])
    surface = found.surface
    assert np.array_equal(scene.world_set.position[found.particles], surface.rest)
    for vertex in surface.vertices[:: len(surface.vertices) // 7]:
        at = np.flatnonzero((surface.triangles == vertex).any(axis=1))
        assert np.array_equal(surface.at_vertex[int(vertex)], at)


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ({"method": {"solver": "xpbd"}}, r"method\.solver = 'xpbd': must be world where bodies and tetrahedra are"),
        ({"method": METHOD | {"ordering": "jacobi"}}, r"ordering.*belongs to the solver xpbd or pbd, not to world"),
        ({"method": METHOD | {"dt": NAN}}, r"method\.dt"),
        ({"method": METHOD | {"substeps": 0}}, r"method\.substeps = 0"),
        (
            {"grid": {"rows": 3, "columns": 3}},
            r"grid\.kind = 'grid': is not supported in a world of bodies and tetrahedra",
        ),
        ({"cloth": {"rows": 3, "columns": 3}}, r"cloth\.kind = 'cloth'.*kind = \"mesh\" with shape = \"sheet\""),
        ({"springs": {}}, r"springs\.kind"),
        ({"self_collision": {}}, r"self_collision\.kind"),
        ({"wind": {}}, r"wind\.kind = 'wind': applies to a cloth; add a table"),
        ({"external": {"magnitude": 1.0}}, r"external\.kind = 'external': is not supported together with bodies"),
        ({"perturbation": {"amplitude": 0.1}}, r"perturbation\.kind = 'perturbation': is not supported in a world"),
        ({"jelly": JELLY | {"spare": 2}}, r"jelly\.spare = 2: spare copies are supported in scenes of bodies only"),
        ({"jelly": JELLY | {"particle_spacing": NAN}}, r"jelly\.particle_spacing"),
        ({"contact": {"distance": 0.0}}, r"contact\.distance = 0\.0"),
        ({"contact": {"sweeps": 0}}, r"contact\.sweeps = 0"),
        ({"held": {"kind": "attachment", "body": "nobody", "vertices": "left"}}, r"held\.body = 'nobody'"),
        ({"block": BLOCK | {"poisson_ratio": 0.6}}, r"block\.poisson_ratio = 0\.6"),
    ],
)
def test_what_does_not_go_together(tables: dict[str, Any], told: str) -> None:
    with pytest.raises(SceneError, match=told) as caught:
        Scene({"block": BLOCK, "jelly": JELLY, "brick": BALL} | tables)
    assert "\n" not in str(caught.value)


def test_a_world_without_a_method_has_one() -> None:
    scene = Scene({"block": BLOCK, "jelly": JELLY})
    assert (scene.method.solver, scene.method.substeps) == ("world", 20)
    assert "pass through each other" in family_of(scene).note(scene)


def test_a_world_with_a_fluid_takes_a_fluids_steps_in_what_it_does_not_tell() -> None:
    """As a scene of the fluid alone does; without a fluid 20 substeps of one iteration."""
    usual = load_scene("float").as_dict()
    told = Scene(usual | {"method": {"solver": "world", "substeps": 6}}).method
    alone = Scene({name: usual[name] for name in usual if name in ("water", "domain", "gravity")}).method
    assert (told.dt, told.substeps, told.iterations) == (alone.dt, 6, alone.iterations)
    dry = Scene({"block": BLOCK, "jelly": JELLY, "method": {"solver": "world"}}).method
    assert (dry.dt, dry.substeps, dry.iterations) == (0.01, 20, 1)  # as without a table


def test_the_plan_is_the_members_and_what_couples_them() -> None:
    """Each member's stages in its own order; without contacts nothing else."""
    scene = world_scene("all")
    plan = scene_plan(scene)
    names = [stage.name for stage in plan.root.stages()]
    for member, own in scene.members.items():
        mine = [name.partition(": ")[2] for name in names if name.startswith(f"{member}: ")]
        assert mine == [stage.name for stage in scene_plan(own).root.stages()]
    cross = [name for name in names if ": " not in name]
    each = ["take positions", "project cross contacts", "give positions"] * 2
    assert cross == (["take predictions", "find cross contacts", *each]) * 3
    alone = scene_plan(world_scene("all", contact=None))
    assert all(": " in stage.name for stage in alone.root.stages())
    report = plan_report(scene, backends=("cpu", "gpu")).as_dict()
    assert report["members"]["bodies"]["bodies"] == 2 and report["members"]["tetrahedra"]["tetrahedra"] > 0
    assert "bodies: " in amounts(scene) and "tetrahedra: " in amounts(scene)


def test_what_is_told_and_written_of_a_world(tmp_path: Any) -> None:
    """Contacts that found no room; strains of all; meshes of every body and the cloth."""
    scene = world_scene("all")
    with open_simulation(scene, "cpu", threads=1, initial=moving(scene)) as simulation:
        simulation.advance(1)
        state = simulation.state()
        found = shortfalls(simulation, state.position, state.inverse_mass)
        assert not any(found[name] for name in ("contacts_lost", "inverted", "caught"))
        strains = [drawn_strain(one, build(one).position) for one in scene.members.values()]
        assert len(drawn_strain(scene, state.position)) == sum(map(len, strains)) == len(simulation.read("strain"))
        target = check_export(str(tmp_path / "all.ply"), None, scene.method.dt, [])
        written = Exporter(simulation, target).finish(simulation, [])
    import trimesh

    mesh = trimesh.load(written[0], process=False)
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx(np.ptp(state.position, axis=0), abs=0.08)
    assert CLOTH["cloth"]["rows"] ** 2 < len(mesh.vertices)
