"""Tetrahedral bodies in partitions of their meshes have the bits of one, in however many shares."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_shared_tetrahedra import BODIES, alone, driven, scene_of
from test_shared_tetrahedra import METHOD as SHARED

from softlab.app.driver import open_simulation
from softlab.cpu_backend.domains.in_threads import run_in_threads
from softlab.cpu_backend.domains.ranks import RankPartitions, on_ranks
from softlab.model.base.errors import SceneError
from softlab.model.core.families import family_of
from softlab.model.core.options import Options
from softlab.model.core.sharing.partitions import SharedMesh, Window, partition
from softlab.model.core.state import State
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


def in_partitions(scene: Scene, count: int, steps: int, **options: Any) -> State:
    """As every rank gathers it; half-way it goes on from a state."""

    def program(ranks: Any) -> State:
        with on_ranks(scene, Options(math="exact", **options), ranks, 1) as simulation:
            assert isinstance(simulation, RankPartitions)
            simulation.advance(steps // 2)
            simulation.load(simulation.state())
            simulation.advance(steps - steps // 2)
            return simulation.state()

    first, *others = run_in_threads(count, program, patience=60)
    assert all(other.position.tobytes() == first.position.tobytes() for other in others)
    return first


def same(found: State, wanted: State) -> bool:
    return bool(
        found.position.tobytes() == wanted.position.tobytes() and found.velocity.tobytes() == wanted.velocity.tobytes()
    )


@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_bar_has_the_bits_of_one(count: int) -> None:
    """It is turned at its end."""
    scene = bars("turned", method=METHOD)
    assert same(in_partitions(scene, count, 6), alone(scene, 6))


@pytest.mark.parametrize("kind", ["hookean", "six", "wholes", "single"])
def test_a_bar_of_every_kind_has_the_bits_of_one(kind: str) -> None:
    """Of every material, order of sweeps and kind of damping; it falls. Multipliers are kept through two iterations, but of
    single tetrahedra, whose 32 colours reach twice as far."""
    scene = bars(kind, method=METHOD if kind == "single" else SHARED)
    assert same(in_partitions(scene, 3, 6), alone(scene, 6))


def test_several_bars_are_cut_where_shares_are_more() -> None:
    """Five shares of two bars, of which one has parts of both."""
    scene = bars("turned", method=METHOD, second=BODIES["turned"] | LONG | place(1))
    assert same(in_partitions(scene, 5, 4), alone(scene, 4))


def test_vertex_block_descent_has_the_bits_of_one() -> None:
    """Colours of vertices are those that they have among all; accelerated."""
    scene = bars("turned", method=DESCENT | {"substeps": 1})
    assert same(in_partitions(scene, 3, 2), alone(scene, 2))


def test_vertices_that_sleep_have_the_bits_of_one() -> None:
    """Those slower than a metre a second, as their neighbours are."""
    scene = bars("turned", method=METHOD | {"sleeping_speed": 1.0})
    assert same(in_partitions(scene, 4, 6), alone(scene, 6))


@METHODS
def test_a_mesh_in_any_order_has_the_bits_of_one(method: dict[str, Any], tmp_path: Path) -> None:
    """A bar whose vertices and tetrahedra are numbered at random, and whose vertices lie a tenth of an edge off a lattice."""
    order, file, lattice = np.random.default_rng(0), tmp_path / "bar.npz", bars("turned", method=METHOD)
    found = lattice.tetrahedra_set
    numbers = order.permutation(found.particle_count)
    position = np.empty_like(found.mesh_position)
    position[numbers] = found.mesh_position + order.uniform(-0.01, 0.01, found.mesh_position.shape)
    np.savez(file, position=position, tetrahedra=order.permutation(numbers[found.tetrahedra]))
    bar = {"kind": "tetrahedral_body", "file": str(file), "young_modulus": 1e4, "pinned": ["left"]}
    scene = scene_of("turned", turned=bar, method=method)
    assert same(in_partitions(scene, 2, 4), alone(scene, 4))


def test_a_force_on_a_vertex_reaches_every_window_that_holds_it() -> None:
    """One beside a cut, in float64; gravity is switched off meanwhile."""
    scene, live = bars("turned", method=METHOD), frozenset({"poke", "gravity"})
    mesh = family_of(scene).partitions
    assert mesh is not None
    poked = int(partition(mesh(scene), 2, "").parts[1].owned[0])

    wanted = driven(poked, open_simulation(scene, threads=1, precision="float64", math="exact", live=live))
    options = Options("float64", "exact", live=live)
    for found in run_in_threads(2, lambda ranks: driven(poked, on_ranks(scene, options, ranks, 1)), patience=60):
        assert same(found, wanted)


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
    assert same(in_partitions(scene, 2, 6), wanted)
    monkeypatch.setattr(partitioned, "partition", thinner)
    assert not same(in_partitions(scene, 2, 6), wanted)


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


@pytest.mark.parametrize(
    "count, changes, said",
    [
        (8, {}, "beyond its neighbours.*use at most 5"),
        (1000, {}, "use at most 5"),
        (2, {"method.iterations": 20}, "use at most 1"),
        (2, {"method.solver": "newton"}, 'scene.replace.*"method.solver": "xpbd"'),
        (2, {"external.magnitude": 1.0}, "a random number for each vertex"),
    ],
)
def test_what_cannot_be_cut_says_so(count: int, changes: dict[str, Any], said: str) -> None:
    scene = load_scene("fem-cantilever").replace(changes)
    with pytest.raises(SceneError, match=said):
        partitioned.partitions(scene, count, None, "--ranks")


def test_partitions_exchange_once_a_substep() -> None:
    """Of a cantilever of 189 vertices, 60 substeps a step: all are owned once, and what is sent is what others hold."""
    cut = partitioned.partitions(load_scene("fem-cantilever"), 2, None, "--ranks")
    assert cut.mesh.exchanges == 60 and np.array_equal(np.sort(cut.order), np.arange(189))
    held = sum(len(part.particles) for part in cut.parts)
    assert sum(len(message.to_places) for message in cut.messages) == held - 189
    with pytest.raises(SceneError, match="once a substep"):
        partitioned.partitions(load_scene("fem-cantilever"), 2, 4, "--ranks")


@pytest.mark.parametrize("solver", ["xpbd", "vbd"])
def test_partitions_have_the_bits_of_one_after_hundreds_of_steps(solver: str) -> None:
    """The gate: bars fall, lie on the ground from the sixth step on, and one is turned all the while."""
    names = [name for name in BODIES if solver == "xpbd" or name != "wholes"]
    scene = bars(*names, method=METHOD | {"solver": solver, "substeps": 4})
    assert same(in_partitions(scene, len(names) + 2, 240), alone(scene, 240))
