"""Wetting of a world's cloth: its vertices and rates for backends (model/world/plan.py, `soak`)."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np

from softlab.model.core.errors import InputError
from softlab.model.scene.scene import Scene
from softlab.model.world.solids import solids_of

RATES = 3  # numbers: soaking, drying, capacity


@dataclass(frozen=True, eq=False)
class Drinkers:
    """Particles of the cloth that carry samples.

    `vertices` (n,): of the cloth; `first`: index of the first among the solids' particles; `lightness` (n,) float64,
    when dry.
    """

    vertices: np.ndarray
    first: int
    lightness: np.ndarray


def drinkers_of(scene: Scene) -> Drinkers:
    """Return the absorbing particles of a world with a [wetting]."""
    solids, place = solids_of(scene), scene.world_set.slices()["cloth"]
    first, stop = np.searchsorted(solids.particles, [place.start, place.stop])
    own = solids.particles[first:stop]
    return Drinkers(own - place.start, int(first), solids.samples.lightness[first:stop])


def rates_of(scene: Scene) -> np.ndarray:
    """Return the fractions of the missing water that is absorbed, and of the water that dries, per substep; the
    capacity; (RATES,) float64."""
    wetting, h = scene.one("wetting"), scene.method.dt / scene.method.substeps
    return np.array([1 - exp(-h / wetting.soaking_time), 1 - exp(-h / wetting.drying_time), wetting.capacity])


def checked_wetness(scene: Scene, wetness: np.ndarray | None) -> np.ndarray:
    """Return a state's wetness, (particles,) float64, 0 where it has none. Raises InputError for another shape, or
    values outside 0 to 1."""
    count = scene.world_set.particle_count
    found = np.zeros(count) if wetness is None else np.asarray(wetness, np.float64)
    if found.shape != (count,) or not ((found >= 0) & (found <= 1)).all():
        raise InputError(f"wetness has shape {found.shape}, this scene needs {(count,)}, of numbers from 0 to 1")
    return found
