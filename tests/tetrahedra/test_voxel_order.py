"""The order of tetrahedra of voxels: every one once, voxels of a colour apart from one another, even layers first."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from tetrahedra_scenes import BODY, tetrahedra_scene

from softlab.model.base.errors import InputError
from softlab.model.particles.constraints import ConstraintSet
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import constraint_sets, tetrahedra_of_sets
from softlab.model.tetrahedra.voxel_order import voxel_order

BAR = BODY | {"shape": {"name": "box", "sides": [0.3, 0.5, 0.4], "resolution": 10}}


def scene_of(**changes: Any) -> Scene:
    return Scene({"body": BAR | {"pinned": []} | changes, "method": {"solver": "xpbd", "dt": 0.01}})


def octopus() -> Scene:
    """A body with copies of voxels."""
    return Scene({
        "body": {"kind": "tetrahedral_body", "shape": {"name": "octopus", "resolution": 32}, "voxels": 20},
        "method": {"solver": "xpbd", "dt": 0.01},
    })  # fmt: skip


def colours(one: ConstraintSet) -> list[np.ndarray]:
    """Of each colour the vertices of its voxels (voxels, vertices)."""
    return [one.corners[first:last].reshape(-1, 4 * one.run) for first, last in pairwise(one.starts)]


@pytest.mark.parametrize("scene", [scene_of(), scene_of(tetrahedra=6), octopus(), tetrahedra_scene("everything")])
def test_voxels_of_a_colour_share_nothing(scene: Scene) -> None:
    sets = constraint_sets(scene)
    tetrahedra = np.concatenate([one.corners for one in sets])
    assert sorted(map(frozenset, tetrahedra.tolist()), key=sorted) == sorted(
        map(frozenset, scene.tetrahedra_set.tetrahedra.tolist()), key=sorted
    )
    for one in sets:
        assert (np.diff(one.starts) % one.run == 0).all()
        for vertices in colours(one):
            own = [set(row) for row in vertices.tolist()]
            assert all(len(some) == 8 for some in own)
            assert len(set.union(*own)) == 8 * len(own)


def test_a_box_has_eight_colours_and_an_octopus_more() -> None:
    (box,) = constraint_sets(scene_of())
    assert (box.colours, box.run, box.kind) == (8, 5, "voxels")
    (six,) = constraint_sets(scene_of(tetrahedra=6))
    assert (six.colours, six.run, six.kind) == (8, 6, "Kuhn voxels")
    (many,) = constraint_sets(octopus())
    assert many.colours > 8  # copies that share vertices


def test_even_layers_across_the_longest_side_come_first() -> None:
    scene = scene_of()
    (one,) = constraint_sets(scene)
    height = scene.tetrahedra_set.position[one.corners, 1].mean(axis=1)  # the longest side is y
    layer = np.floor((height - height.min()) / 0.1 + 1e-6).astype(int)
    half = one.starts[4]
    assert (layer[:half] % 2 == 0).all() and (layer[half:] % 2 == 1).all()


def test_a_sweep_is_the_voxels_tetrahedra_in_turn() -> None:
    (one,) = constraint_sets(scene_of())
    sweep = one.sweep
    assert len(sweep) == 8 * 5 and sorted(np.concatenate(sweep).tolist()) == list(range(len(one.corners)))
    for members in sweep:
        vertices = one.corners[members].ravel()
        assert len(np.unique(vertices)) == len(vertices)
    assert np.array_equal(sweep[0] + 1, sweep[1])  # a voxel's second tetrahedron after its first one


@pytest.mark.parametrize("scene", [scene_of(angle=30.0), octopus()])
def test_five_stand_around_the_last_with_the_values_of_their_corners(scene: Scene) -> None:
    """As Projection.around says, which kernels rely on; B takes edges at rest to a rotation, whatever their order."""
    (one,) = constraint_sets(scene)
    voxels, found = one.corners.reshape(-1, 5, 4), scene.tetrahedra_set
    core = voxels[:, 4]
    for m in range(4):
        assert np.array_equal(voxels[:, m, 1:], core[:, [(m + n) % 4 for n in (1, 2, 3)]])
        assert (voxels[:, m, :1] != core).all()
    at = found.position[one.corners]
    edges = np.swapaxes(at[:, 1:] - at[:, :1], 1, 2)
    rows = np.zeros((len(edges), 3, 3))
    rows[:, *np.triu_indices(3)] = one.values[:, :6]
    turned = edges @ rows
    assert np.abs(np.swapaxes(turned, 1, 2) @ turned - np.eye(3)).max() < 1e-11
    assert np.abs(np.linalg.det(turned) - 1).max() < 1e-11
    (chosen,) = tetrahedra_of_sets(found)
    assert np.array_equal(np.sort(found.tetrahedra[chosen]), np.sort(one.corners))


def test_free_meshes_keep_their_colours_beside_voxels(tmp_path: Any) -> None:
    file = tmp_path / "one.vtk"
    file.write_text(
        "# vtk DataFile Version 3.0\none\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n"
        "0 0 0  1 0 0  0 1 0  0 0 1\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\n"
    )
    free = {"kind": "tetrahedral_body", "file": str(file)}
    scene = Scene({"free": free, "body": BODY, "method": {"solver": "xpbd", "dt": 0.01}})
    assert [(one.run, one.model, len(one.corners)) for one in constraint_sets(scene)] == [
        (1, "fixed-corotated", 1), (5, "fixed-corotated", 10),
    ]  # fmt: skip


def test_a_body_whose_voxels_are_not_where_they_say_is_refused() -> None:
    found = scene_of().tetrahedra_set
    fields = vars(found) | {"voxel": np.zeros_like(found.voxel)}
    fields = {name: fields[name] for name in TetrahedraSet.__dataclass_fields__}
    wrong = TetrahedraSet(**fields | {"voxel": found.voxel * 2})
    with pytest.raises(InputError, match="cook it again"):
        voxel_order(wrong, np.arange(len(found.tetrahedra)), 5)
