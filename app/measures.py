"""The numbers that the demo shows about its worlds. They need the whole state on the host, so not in every frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.camera import finite_bounds, joined_bounds
from app.colours import strain_range
from app.surface import drawn_strain
from model.energy import energies
from model.scene import Scene
from model.simulation import Simulation

KEEP_RANGE = 2.6  # times the wanted range of colours: a legend that flickers between two ranges cannot be read


@dataclass(frozen=True)
class Statistics:
    """What is shown about the first world: energy [J], the strain of largest size and the range of colours (both
    relative to the rest length), `bounds` of all worlds [m] as `finite_bounds` gives them."""

    energy: float = 0.0
    kinetic: float = 0.0
    worst_strain: float = 0.0
    strain_range: float = 0.1
    bounds: tuple[float, ...] = (0.0, 0.0, 1.0, 1.0)


def measure(world: Simulation, positions: Sequence[np.ndarray], before: Statistics) -> Statistics:
    """The statistics of `world` now; bounds from all `positions` (each (particles, dimensions)). Raises Diverged."""
    state = world.state()
    energy = energies(world.scene, state.position, state.velocity)
    strain = drawn_strain(world.scene, state.position)
    wanted = strain_range(strain)
    if wanted < before.strain_range <= KEEP_RANGE * wanted:
        wanted = before.strain_range
    return Statistics(energy["total"], energy["kinetic"], _worst(strain), wanted, _bounds(positions, before))


def measure_picture(scene: Scene, positions: Sequence[np.ndarray], before: Statistics) -> Statistics:
    """`before` (its energy), with strain and bounds of another picture: the one that is shown after divergence."""
    strain = drawn_strain(scene, positions[0])
    bounds = _bounds(positions, before)
    return replace(before, worst_strain=_worst(strain), strain_range=strain_range(strain), bounds=bounds)


def _worst(strain: np.ndarray) -> float:
    return float(strain[np.argmax(np.abs(strain))]) if len(strain) else 0.0


def _bounds(positions: Sequence[np.ndarray], before: Statistics) -> tuple[float, ...]:
    every = [bounds for bounds in map(finite_bounds, positions) if bounds]
    return joined_bounds(every) if every else before.bounds
