"""The numbers that the demo shows about its worlds. They need the whole state on the host and are not computed in every
frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softlab.app.outcome import fault_words
from softlab.app.presentation import presentation_of
from softlab.app.render.camera import finite_bounds, joined_bounds
from softlab.app.render.colours import strain_range
from softlab.app.render.drawn_springs import drawn_strain
from softlab.app.render.fluid.framing import main_part, with_fluids
from softlab.model.contact.shortfalls import inverted_elements
from softlab.model.core.build import masses
from softlab.model.core.energy import energies
from softlab.model.core.simulation import Simulation
from softlab.model.core.spare import inactive, present
from softlab.model.scene.scene import Scene

RANGE_HYSTERESIS = 2.6  # times the wanted range of colours: a legend that flickers between two ranges cannot be read


@dataclass(frozen=True)
class Statistics:
    """Numbers that are shown about a world.

    Energy [J]; the strain of largest size, relative to the rest length (of fluids the largest density over the rest
    density, minus 1; NaN for many particles); the `momentum` [kg m/s] along each axis, if requested; of all worlds
    the range of colours and the `bounds` [m], as `finite_bounds` returns them; `fastest` [m/s]: of a fluid's
    particles; `faults`: what is incomplete so far, in a few words; only tetrahedra and lists of contacts, which are
    fast to count.
    """

    energy: float = 0.0
    kinetic: float = 0.0
    worst_strain: float = 0.0
    strain_range: float = 0.1
    bounds: tuple[float, ...] = (0.0, 0.0, 1.0, 1.0)
    momentum: tuple[float, ...] = ()
    fastest: float = 0.0
    faults: str = ""


def measure(
    worlds: Sequence[Simulation],
    current: int,
    positions: Sequence[np.ndarray],
    before: Statistics,
    momentum: bool = False,
) -> Statistics:
    """Return the statistics of the world `current` of `worlds`; of the others only `positions` (each (particles,
    dimensions)) are needed. Raises Diverged."""
    world = worlds[current]
    state = world.state()
    energy = energies(world.scene, state.position, state.velocity, state.arrays, state.inverse_mass)
    strain = drawn_strain(world.scene, state.position)
    others = [drawn_strain(w.scene, p) for w, p in zip(worlds, positions, strict=True) if w is not world]
    wanted = max(map(strain_range, [strain, *others]))
    if wanted < before.strain_range <= RANGE_HYSTERESIS * wanted:
        wanted = before.strain_range
    active = [
        main_part(w.scene, p) if with_fluids(w.scene) else present(w.scene, p, w.body.inverse_mass)
        for w, p in zip(worlds, positions, strict=True)
    ]
    pushed: tuple[float, ...] = ()
    if momentum:
        mass = masses(world.scene, inactive(world.scene, state.inverse_mass))
        pushed = tuple(np.atleast_1d(np.sum(mass * state.velocity, axis=0, dtype=np.float64)).tolist())
    fastest = float(np.sqrt((state.velocity**2).sum(axis=1).max())) if presentation_of(world.scene).fastest else 0.0
    worst = presentation_of(world.scene).worst(world.scene, state.position, strain)
    bounds = _bounds(active, before)
    faults = fault_words({**world.faults(), **inverted_elements(world.scene, state.position)})
    return Statistics(energy["total"], energy["kinetic"], worst, wanted, bounds, pushed, fastest, faults)


def measure_picture(
    scenes: Sequence[Scene], current: int, positions: Sequence[np.ndarray], before: Statistics
) -> Statistics:
    """Return `before` with the strain and bounds of another picture, the one that is shown after divergence."""
    strains = [drawn_strain(scene, position) for scene, position in zip(scenes, positions, strict=True)]
    active = [main_part(scene, position) for scene, position in zip(scenes, positions, strict=True)]
    wanted, bounds = max(map(strain_range, strains)), _bounds(active, before)
    worst = presentation_of(scenes[current]).worst(scenes[current], positions[current], strains[current])
    return replace(before, worst_strain=worst, strain_range=wanted, bounds=bounds)


def _bounds(positions: Sequence[np.ndarray], before: Statistics) -> tuple[float, ...]:
    every = [bounds for bounds in map(finite_bounds, positions) if bounds]
    return joined_bounds(every) if every else before.bounds
