"""Tetrahedral bodies in partitions of their meshes: pokes, halos, what cannot be cut (bits: test_shares.py)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shares import alone, same, shared
from test_shared_tetrahedra import BODIES, scene_of
from test_shared_tetrahedra import METHOD as SHARED
from tetrahedra_scenes import folder

from softlab.cpu_backend.domains.in_threads import run_in_threads
from softlab.cpu_backend.domains.ranks import on_ranks
from softlab.model.base.errors import SceneError
from softlab.model.core.options import Options
from softlab.model.core.sharing.partitions import SharedMesh, Window
from softlab.model.domains import partitioned
from softlab.model.scene.scene import Scene, load_scene

LONG = {"shape": {"name": "box", "sides": [3.2, 0.1, 0.1]}}
METHOD = SHARED | {"iterations": 1}
DESCENT = METHOD | {"solver": "vbd", "iterations": 2, "chebyshev": 0.9}
METHODS = pytest.mark.parametrize("method", [METHOD, DESCENT], ids=["xpbd", "vbd"])


def bars(*names: str, **more: Any) -> Scene:
    """The bodies of test_shared_tetrahedra.py by these names, as long as 32 voxels."""
    return scene_of(*names, **{name: BODIES[name] | LONG | place(n) for n, name in enumerate(names or BODIES)}, **more)


def place(n: int) -> dict[str, Any]:
    return {"origin": [0.0, 0.11, float(n)]}


def bar_in_any_order(method: dict[str, Any]) -> Scene:
    """A bar whose vertices and tetrahedra are numbered at random, and whose vertices lie a tenth of an edge off a lattice."""
    order, file, lattice = np.random.default_rng(0), Path(folder().name) / "bar.npz", bars("turned", method=METHOD)
    found = lattice.tetrahedra_set
    numbers = order.permutation(found.particle_count)
    position = np.empty_like(found.mesh_position)
    position[numbers] = found.mesh_position + order.uniform(-0.01, 0.01, found.mesh_position.shape)
    np.savez(file, position=position, tetrahedra=order.permutation(numbers[found.tetrahedra]))
    bar = {"kind": "tetrahedral_body", "file": str(file), "young_modulus": 1e4, "pinned": ["left"]}
    return scene_of("turned", turned=bar, method=method)


@METHODS
def test_a_halo_that_lacks_its_last_layer_is_told_by_the_bits(
    method: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The walk finds no more than is needed: without the outermost layer of vertices and what touches it, bits differ."""
    scene, cut = bars("turned", method=method), partitioned.partition

    def thinner(mesh: SharedMesh, count: int, option: str) -> Any:
        def window(owned: np.ndarray) -> Window:
            particles, elements = mesh.window(owned)
            layers = mesh.layers[particles]
            outside = layers[~owned[particles]]
            last = outside.max() if outside.max() > mesh.layers[owned].max() else outside.min()
            left = particles[layers != last]
            corners = scene.tetrahedra_set.tetrahedra[elements]
            return left, elements[np.isin(corners, left).all(axis=1)]

        return cut(replace(mesh, window=window), count, option)

    wanted = alone(scene, 6)
    assert same(shared(scene, 2, 6)[0], wanted)
    monkeypatch.setattr(partitioned, "partition", thinner)
    assert not same(shared(scene, 2, 6)[0], wanted)


def test_a_bad_vertex_is_told_by_its_number_in_the_whole() -> None:
    """One of the second share, to all."""
    scene, bad = bars("turned", method=METHOD), 100

    def program(ranks: Any) -> int:
        with on_ranks(scene, Options(math="exact"), ranks, 1) as simulation:
            position, velocity = simulation._download()
            position[bad] = np.nan
            simulation._upload(position, velocity)
            return simulation._first_diverged()

    assert run_in_threads(2, program, patience=60) == [bad, bad]


def test_partitions_exchange_once_a_substep() -> None:
    """Of a cantilever of 189 vertices, 60 substeps a step: all are owned once, and what is sent is what others hold."""
    cut = partitioned.partitions(load_scene("fem-cantilever"), 2, None, "--ranks")
    assert cut.mesh.exchanges == 60 and np.array_equal(np.sort(cut.order), np.arange(189))
    held = sum(len(part.particles) for part in cut.parts)
    assert sum(len(message.to_places) for message in cut.messages) == held - 189
    with pytest.raises(SceneError, match="once a substep"):
        partitioned.partitions(load_scene("fem-cantilever"), 2, 4, "--ranks")
