"""What vertex block descent visits: colours and lists of vertices."""

from __future__ import annotations

import numpy as np
import pytest
from vbd_scenes import BODY, EVERYTHING, FREE, vbd_scene

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.core.families import family_of, scene_plan
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.descent import descents, neighbours, vertex_colours
from softlab.model.tetrahedra.vbd import TETRAHEDRA_VBD

BEAM = BODY | {"shape": {"name": "box", "sides": [0.6, 0.3, 0.3]}}


@pytest.mark.parametrize("cut,most", [(5, 4), (6, 9)])
def test_no_two_vertices_of_a_colour_share_a_tetrahedron(cut: int, most: int) -> None:
    """Five tetrahedra of a voxel take four colours, the fewest that there can be; the same whenever they are asked for."""
    found = vbd_scene(BEAM | {"tetrahedra": cut}).tetrahedra_set
    colours = vertex_colours(found.tetrahedra, found.particle_count)
    corners = colours[found.tetrahedra]
    assert all(len(set(four)) == 4 for four in corners.tolist())
    assert colours.max() + 1 <= most
    assert np.array_equal(colours, vertex_colours(found.tetrahedra, found.particle_count))


def test_neighbours_are_those_of_the_tetrahedra() -> None:
    found = vbd_scene(BEAM).tetrahedra_set
    near = neighbours(found.tetrahedra, found.particle_count)
    for vertex in (0, 5, found.particle_count - 1):
        at = found.tetrahedra[(found.tetrahedra == vertex).any(axis=1)]
        assert near[vertex].tolist() == sorted(set(at.ravel().tolist()) - {vertex})


def test_every_free_vertex_is_visited_once_with_all_its_tetrahedra() -> None:
    scene = Scene(EVERYTHING)
    found, seen = scene.tetrahedra_set, []
    lists = descents(scene)
    assert [one.material for one in lists] == ["fixed-corotated", "corotated", "neo-hookean"]
    for one in lists:
        for colour in range(one.colours):
            some = one.order[one.starts[colour] : one.starts[colour + 1]]
            assert len(some) and (np.diff(some) > 0).all()
            assert (np.isin(found.tetrahedra, some).sum(axis=1) <= 1).all(), "two vertices that are visited at once"
        for k, vertex in enumerate(one.order[: one.free].tolist()):
            entries = one.entries[one.offsets[k] : one.offsets[k + 1]]
            assert (np.diff(entries) > 0).all()
            assert (one.corners[entries >> 2, entries & 3] == vertex).all()
            assert len(entries) == (found.tetrahedra == vertex).sum()
        held = one.order[one.free :]
        assert np.isin(held, found.pinned_vertices).all() and one.offsets[-1] == len(one.entries)
        assert (one.falls == (one.material != "fixed-corotated")).all()  # the one that is pinned
        seen += one.order[: one.free].tolist()
    assert sorted(seen) == np.setdiff1d(np.arange(found.particle_count), found.pinned_vertices).tolist()


def test_a_scene_of_it_is_its_familys_and_told() -> None:
    scene = vbd_scene(BODY | {"damping": 0.01}, substeps=3)
    assert family_of(scene) is TETRAHEDRA_VBD
    names = [stage.name for stage in scene_plan(scene).root.stages()]
    first = ["predict", "strain fixed-corotated", "start fixed-corotated", "descend fixed-corotated 0"]
    assert names[:4] == first and names.count("predict") == 3 and names.count(first[3]) == 6
    assert "strain fixed-corotated" not in [stage.name for stage in scene_plan(vbd_scene()).root.stages()]
    assert scene.method.label == "vbd"
    with pytest.raises(SceneError, match="tetrahedral bodies"):
        Scene({"cloth": {"rows": 3, "columns": 3}, "method": {"solver": "vbd"}})


def test_a_body_of_pins_alone_stays() -> None:
    scene = vbd_scene(BODY | {"pinned": ["left", "right"], "edge": 0.2})
    with open_simulation(scene, precision="float64", math="exact") as simulation:
        simulation.advance(2)
        assert np.array_equal(simulation.read("position"), scene.tetrahedra_set.position)


def test_free_bodies_fall() -> None:
    assert all((one.falls == 1).all() for one in descents(vbd_scene(FREE)))
