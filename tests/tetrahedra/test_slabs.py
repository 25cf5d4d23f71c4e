"""Slabs of voxels, as the host cuts them: who owns what, who hears of what, and that nothing is forgotten."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tetrahedra_scenes import BODY, tetrahedra_scene

from softlab.gpu_backend.tetrahedra.resident_launch import chosen_slabs, default_slabs, layers_of
from softlab.gpu_backend.tetrahedra.slabs import (
    ALL,
    BORDER_AFTER,
    BORDER_BEFORE,
    HEADER,
    LIST,
    LOCAL,
    SHARED,
    STARTS,
    Slabs,
)
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import constraint_sets

LIMITS = (132, 200_000)  # blocks at once, bytes of shared memory


def scene_of(**changes: Any) -> Scene:
    body = BODY | {"shape": {"name": "box", "sides": [0.3, 0.9, 0.2], "resolution": 10}} | changes
    return Scene({"body": body, "method": {"solver": "xpbd", "dt": 0.01}})


def octopus() -> Scene:
    """With copies of voxels."""
    body = {"kind": "tetrahedral_body", "shape": {"name": "octopus", "resolution": 32}, "voxels": 20}
    return Scene({"body": body, "method": {"solver": "xpbd", "dt": 0.01}})


def heads(slabs: Slabs) -> np.ndarray:
    return slabs.tables[: slabs.count * HEADER].reshape(-1, HEADER)


def particles(slabs: Slabs, k: int) -> np.ndarray:
    head = heads(slabs)[k]
    return slabs.tables[head[LIST] : head[LIST] + head[ALL]]


@pytest.mark.parametrize("layers", [2, 4, 10])
@pytest.mark.parametrize("scene", [scene_of(), octopus(), tetrahedra_scene("everything"), scene_of(tetrahedra=6)])
def test_every_vertex_has_one_owner_and_every_tetrahedron_one_place(scene: Scene, layers: int) -> None:
    found = scene.tetrahedra_set
    owners: list[np.ndarray] = []
    for one, slabs in zip(constraint_sets(scene), chosen_slabs(scene, np.float32, layers, LIMITS), strict=True):
        assert sorted(slabs.order.tolist()) == list(range(len(one.corners)))
        for k, head in enumerate(heads(slabs)):
            known = particles(slabs, k)
            owners.append(known[: head[LOCAL]])
            assert len(np.unique(known)) == len(known) <= slabs.largest
            starts = slabs.tables[head[STARTS] : head[STARTS] + slabs.colours + 1]
            assert np.diff(starts).max() <= slabs.widest
            places = slice(one.run * starts[0], one.run * starts[-1])
            assert np.array_equal(known[slabs.corners[places]], one.corners[slabs.order[places]])
            early = slabs.corners[one.run * starts[0] : one.run * starts[slabs.early]]
            assert early.size == 0 or early.max() < head[LOCAL]  # even layers need nobody else's
    assert sorted(np.concatenate(owners).tolist()) == list(range(found.particle_count))


@pytest.mark.parametrize("scene", [scene_of(), octopus()])
def test_neighbours_mean_the_same_vertices(scene: Scene) -> None:
    (slabs,) = chosen_slabs(scene, np.float32, 2, LIMITS)
    head = heads(slabs)
    assert slabs.count > 3 and slabs.borders > 0
    for k in range(slabs.count - 1):
        foreign = particles(slabs, k)[head[k, LOCAL] :]
        assert np.array_equal(foreign, particles(slabs, k + 1)[: head[k + 1, SHARED]])
        assert head[k, BORDER_AFTER] == head[k + 1, BORDER_BEFORE]
    assert head[0, SHARED] == 0 and head[-1, LOCAL] == head[-1, ALL]


def test_slabs_thicken_until_all_run_at_once() -> None:
    scene = scene_of()  # nine layers
    assert [slabs.count for slabs in chosen_slabs(scene, np.float32, None, LIMITS)] == [5]
    assert [slabs.count for slabs in chosen_slabs(scene, np.float32, None, (3, 200_000))] == [3]
    assert [slabs.count for slabs in chosen_slabs(scene, np.float32, None, (1, 200_000))] == [1]
    assert default_slabs(scene, np.float32, (1, 1000)) == []
    assert default_slabs(tetrahedra_scene("free"), np.float32, LIMITS) == []


def test_kernels_that_are_none_are_refused() -> None:
    assert (layers_of("resident"), layers_of("resident:6")) == (None, 6)
    for name in ("resident:", "resident:0", "resident:3", "resident:-2", "resident:x"):
        with pytest.raises(SceneError, match="even"):
            layers_of(name)
