"""A scene on several CPU ranks has the bits of one, whatever it is made of and however many they are: grids and cloths in
windows, bodies in shares, fluids in slabs, meshes in partitions. test_mpi.py runs processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import pytest
import test_partitions as partitions
import test_ranks as grids
import test_shared_bodies as bodies
import test_shared_fluid as fluids
import test_shared_tetrahedra as tetrahedra
from shares import alone, same, shared

from softlab.app.driver import open_simulation
from softlab.cpu_backend.domains.in_threads import run_in_threads
from softlab.cpu_backend.domains.ranks import on_ranks
from softlab.model.base.errors import Diverged
from softlab.model.core.families import family_of
from softlab.model.core.options import Options
from softlab.model.core.sharing.partitions import partition
from softlab.model.core.state import State
from softlab.model.domains import shared_fluid
from softlab.model.scene.scene import Scene, load_scene

TURNED = partial(partitions.bars, "turned", method=partitions.METHOD)
ALL_BUT_WHOLES = [name for name in tetrahedra.BODIES if name != "wholes"]
HUNDREDS = "hundreds of steps"


@dataclass(frozen=True)
class Row:
    """A scene, in how many shares, for how many steps, and how many of them lie between exchanges."""

    name: str
    scene: Callable[[], Scene]
    counts: tuple[int, ...]
    steps: int
    every: int | None = None
    options: dict[str, Any] = field(default_factory=dict)
    rest: bool = False


def windows() -> Iterator[Row]:
    for name in grids.SCENES:
        yield Row(f"grid {name}", partial(grids.scene_of, name), (2, 3), 24)
    for every in (1, 2, 5):  # 7 steps are no multiple of it, and end with an exchange all the same
        yield Row(f"every {every}", partial(grids.scene_of, "verlet", rows=26), (3,), 14, every)
    yield Row("a row each", partial(grids.scene_of, "lab", rows=4), (4,), 10)
    double = {"precision": "float64", "kernel": "stages"}
    yield Row("grid by stages", partial(grids.scene_of, "random"), (2,), 6, options=double)
    for name, integrator, _ in grids.CLOTHS:
        yield Row(f"{name} {integrator}", partial(grids.cloth_of, name, integrator), (2,), 8, 1)


def apart() -> Iterator[Row]:
    """Bodies on the ground within 8 steps; tetrahedra of every material, order of sweeps and kind of damping."""
    yield Row("bodies", bodies.scene_of, (3, 4, 7), 8)
    double = {"precision": "float64", "kernel": "stages"}
    yield Row("bodies by stages", partial(bodies.scene_of, "soft", "block"), (2,), 2, options=double)
    yield Row(f"bodies {HUNDREDS}", lambda: load_scene("plastic"), (2, 4), 500)
    yield Row("tetrahedra", tetrahedra.scene_of, (2, 3, 4, 7), 4)
    for chebyshev in (0.0, 0.9):  # colours of vertices are those that they have among all
        method = tetrahedra.METHOD | {"solver": "vbd", "iterations": 3, "substeps": 1, "chebyshev": chebyshev}
        scene = partial(tetrahedra.scene_of, *ALL_BUT_WHOLES, method=method)
        yield Row(f"tetrahedra by vertices {chebyshev}", scene, (4,), 2)
    sleeping = tetrahedra.METHOD | {"sleeping_speed": 1.0}
    scene = partial(tetrahedra.scene_of, "turned", "hookean", "single", method=sleeping)
    yield Row("tetrahedra that sleep", scene, (2,), 4)


def meshes() -> Iterator[Row]:
    """A bar is turned at its end; multipliers are kept through two iterations, but of single tetrahedra, whose 32 colours
    reach twice as far; five shares of two bars, of which one has parts of both."""
    yield Row("bar", TURNED, (3, 4), 6)
    yield Row("bar in two", TURNED, (2,), 6, rest=True)
    for kind in ("hookean", "six", "wholes", "single"):
        method = partitions.METHOD if kind == "single" else partitions.SHARED
        yield Row(f"bar {kind}", partial(partitions.bars, kind, method=method), (3,), 6, rest=True)
    second = tetrahedra.BODIES["turned"] | partitions.LONG | partitions.place(1)
    yield Row("two bars", partial(TURNED, second=second), (5,), 4)
    descent, sleeping = partitions.DESCENT | {"substeps": 1}, partitions.METHOD | {"sleeping_speed": 1.0}
    yield Row("bar by vertices", partial(TURNED, method=descent), (3,), 2)
    yield Row("bar that sleeps", partial(TURNED, method=sleeping), (4,), 6, rest=True)
    for method in (partitions.METHOD, partitions.DESCENT):
        scene = partial(partitions.bar_in_any_order, method)
        yield Row(f"bar in any order {method['solver']}", scene, (2,), 4, rest=method is partitions.DESCENT)
    for solver in ("xpbd", "vbd"):  # they fall, come to rest, and one is turned all the while
        names = [name for name in tetrahedra.BODIES if solver == "xpbd" or name != "wholes"]
        method = {"solver": solver, "substeps": 4}
        scene = partial(tetrahedra.scene_of, *names, method=tetrahedra.METHOD | method)
        yield Row(f"tetrahedra {HUNDREDS} {solver}", scene, (3,), 300)
        scene = partial(partitions.bars, *names, method=partitions.METHOD | method)
        yield Row(f"bars {HUNDREDS} {solver}", scene, (len(names) + 2,), 240)


def slabs() -> Iterator[Row]:
    small, double = partial(fluids.dam, water__size=[0.8, 0.15]), {"precision": "float64"}
    yield Row("dam", small, (3,), 10)
    yield Row("dam in float64", small, (3,), 10, options=double, rest=True)
    yield Row(f"dam {HUNDREDS}", fluids.dam, (2, 3, 4), 200)
    for name, parts in fluids.PARTS.items():
        yield Row(f"dam {name} {HUNDREDS}", partial(fluids.dam, **parts), (2,), 200)


ROWS = (*windows(), *apart(), *meshes(), *slabs())


@pytest.mark.parametrize(
    "row, count",
    [
        pytest.param(
            row, count, id=f"{row.name}-{count}".replace(" ", "-"), marks=[pytest.mark.rest] if row.rest else []
        )
        for row in ROWS
        for count in row.counts
    ],
)
def test_shares_have_the_bits_of_one(row: Row, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fluid's particles cross between slabs, which are balanced anew on the way."""
    if HUNDREDS not in row.name:
        monkeypatch.setattr(shared_fluid, "BALANCED_EVERY", 4)
    scene = row.scene()
    wanted: State = alone(scene, row.steps, **row.options)
    assert wanted.plastic is None or np.abs(wanted.plastic - np.eye(3)).max() > 1e-3, "nothing was pressed"
    for found in shared(scene, count, row.steps, row.every, **row.options):
        assert same(found, wanted)


def beside_a_cut(scene: Scene) -> int:
    """A vertex of the second of two shares of a mesh."""
    mesh = family_of(scene).partitions
    assert mesh is not None
    return int(partition(mesh(scene), 2, "").parts[1].owned[0])


PUSHED: dict[str, tuple[Callable[[], Scene], Callable[[Scene], int], tuple[float, ...], str]] = {
    # scene, particle, force [N], precision; row 12 of the grid is the second rank's, and in no other's window
    "grid": (partial(grids.scene_of, "lab"), lambda scene: 60, (0.5, -0.25), "float32"),
    "tetrahedra": (
        partial(tetrahedra.scene_of, "turned", "single", "six"),
        lambda scene: scene.tetrahedra_set.particle_count - 2, (0.0, 20.0, 5.0), "float64",
    ),
    "beside a cut": (TURNED, beside_a_cut, (0.0, 20.0, 5.0), "float64"),
}  # fmt: skip


@pytest.mark.parametrize("name", PUSHED)
def test_a_force_on_one_particle_reaches_every_window_that_holds_it(name: str) -> None:
    """It is let go when gravity is switched off."""
    make, particle_of, force, precision = PUSHED[name]
    scene, live = make(), frozenset({"poke", "gravity"})
    particle = particle_of(scene)

    def pushed(simulation: Any) -> State:
        with simulation:
            simulation.poke(particle, force)
            simulation.advance(2)
            simulation.set("gravity.enabled", False)
            simulation.poke(None)
            simulation.advance(2)
            return simulation.state()

    wanted = pushed(open_simulation(scene, threads=1, precision=precision, math="exact", live=live))
    options = Options(precision, "exact", live=live)
    for found in run_in_threads(2, lambda ranks: pushed(on_ranks(scene, options, ranks, 1)), patience=60):
        assert same(found, wanted)


@pytest.mark.parametrize(
    ("make", "changes", "steps"),
    [
        (partial(grids.scene_of, "lab"), {"method.dt": 0.07}, 4000),  # twice the limit of the step size
        (partial(bodies.scene_of, "soft", "rigid"), {"rigid.velocity": [0.0, 1e8, 0.0]}, 8),  # 1000 km a step
    ],
    ids=["grid", "bodies"],
)
def test_they_diverge_where_one_does(make: Callable[[], Scene], changes: dict[str, Any], steps: int) -> None:
    """The same first bad step and particle are named."""
    scene = make().replace(changes)
    with pytest.raises(Diverged) as of_one:
        alone(scene, steps, allow_unstable=True)
    with pytest.raises(Diverged) as of_two:
        shared(scene, 2, steps)
    assert (of_two.value.step, of_two.value.particle) == (of_one.value.step, of_one.value.particle)
