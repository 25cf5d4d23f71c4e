"""The table of scenes whose states are near those of the NumPy reference: rows of the table of bits, with bounds that follow
from rounding. test_near.py has the check. Solvers whose references are asked otherwise have tests of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import mesh_scenes
import numpy as np
import wet_scenes
import world_scenes
from bits_row import CPU, PRECISIONS, Row
from bits_rows import KINDS, ROWS

from softlab.bench.reference import mass_spring, shape_matching, tetrahedra_cloth, world, xpbd_mesh
from softlab.bench.reference.contact import self_contacts
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.core.state import State
from softlab.model.geometry.topology import vertex_masses
from softlab.model.scene.scene import Scene

Pair = tuple[np.ndarray, np.ndarray]  # position [m] and velocity [m/s]


@dataclass(frozen=True)
class Near:
    """`reference`: of (scene, steps, start, poke); `position` [m], `velocity` [m/s]: bounds in float64, of float32 2^29 times
    as wide; `rest`: run by `--rest` alone."""

    row: Row
    reference: Callable[[Scene, int, State, Any], Pair]
    position: float
    velocity: float
    precisions: tuple[str, ...] = ("float64",)
    rest: bool = False

    def expected(self, scene: Scene, begin: State) -> Pair:
        """The reference's state after the steps that the row takes on the CPU."""
        poke = self.row.poke and (self.row.poke[0], np.array(self.row.poke[1]))
        return self.reference(scene, self.row.steps[CPU], begin, poke)


def of_bodies(scene: Scene, steps: int, begin: State, poke: Any) -> Pair:
    return shape_matching.simulate(scene, steps, poke=poke)


def of_meshes(scene: Scene, steps: int, begin: State, poke: Any) -> Pair:
    assert scene.mesh is not None
    return xpbd_mesh.simulate(scene, steps, begin.position, begin.velocity, vertex_masses(scene.mesh), poke=poke)


def of_folds(scene: Scene, steps: int, begin: State, poke: Any) -> Pair:
    return self_contacts.simulate(scene, steps, *mass_spring.start(scene), MAX_CONTACTS)


def of_members(simulate: Any, distance: float, scene: Scene, steps: int, begin: State, poke: Any) -> Pair:
    """`distance` [m]: of contacts."""
    pair: Pair = simulate(scene, steps, begin.position, begin.velocity, MAX_CONTACTS, distance)
    return pair


def rows() -> Iterator[Near]:
    """Bodies: errors that velocities carry on grow with the square of the substeps' number; velocities are positions over h.

    bodies, of all materials: 10 substeps of 2 iterations, some 30 roundings of 2 m each: 100 x 60 x 1.1e-16 m; lattices: of
    4 m; linked: 8 colours, some 60 roundings of 2 m each: 100 x 60 x 1.1e-16 m x 2, twice that; meeting, bounces: 16 substeps
    of 2 iterations of 2 sweeps over some 5 contacts of ten roundings of 1 m each: 16^2 x 4 x 50 x 1.1e-16 m; rebound: 40
    substeps of ten roundings of 1 m, half the square of their number: 800 x 10 x 1.1e-16 m, velocities 2 / h of that;
    impacts: two substeps, some hundred operations on 1 m.
    Folds: 30 substeps of some hundred roundings of lengths under 1 m, which contacts forget rather than let grow.
    Meshes: a few thousand operations on lengths of 1 m, which rigid constraints and colliders magnify little in 4 steps.
    Worlds: some thousand operations on lengths of 0.3 m, after some dozen projections; slopes of water divide by distances.
    """
    by_name = {row.name: row for row in ROWS}
    h = 0.005
    for name, bound, precisions in (
        ("bodies", 1e-12, PRECISIONS), ("of all materials", 1e-12, ("float64",)), ("lattices", 2e-12, PRECISIONS),
        ("linked", 3e-12, PRECISIONS), ("meeting", 6e-12, PRECISIONS), ("bounces", 6e-12, PRECISIONS),
        *((f"impact {kind}", 200 * 2.0**-53, ("float64",)) for kind in KINDS),
    ):  # fmt: skip
        rest = name in ("meeting", "bounces", "lattices")
        yield Near(by_name[name], of_bodies, bound, bound / h, precisions, rest)
    yield Near(by_name["rebound"], of_bodies, 9e-13, 2 * 9e-13 / h, PRECISIONS, rest=True)
    for name in ("folded strip", "folded strip jacobi"):
        yield Near(by_name[name], of_folds, 1e-12, 1e-12 * 240, rest="jacobi" not in name)
    for name in mesh_scenes.PARTS:
        yield Near(by_name[f"mesh {name}"], of_meshes, 1e-11, 5e-9, rest=name == "volume")
    for name in ("on a cloth", "tied"):
        beside = partial(of_members, tetrahedra_cloth.simulate, 0.01)
        yield Near(by_name[f"tetrahedra {name}"], beside, 1e-12, 2e-10, rest=name == "tied")
    together = partial(of_members, world.simulate, 0.02)
    for name in world_scenes.PARTS:
        if name != world_scenes.BY_VERTICES:
            yield Near(by_name[f"world {name}"], together, 1e-11, 3e-9, rest=name == "all")
    for name in wet_scenes.PARTS:
        yield Near(by_name[f"wet {name}"], together, 1e-11, 4e-9, rest=True)
