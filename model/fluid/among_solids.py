"""Data on solids for a fluid's solvers, in addition to their samples."""

from __future__ import annotations

import numpy as np

from softlab.model.fluid.samples import Samples
from softlab.model.scene.scene import Scene

KINDS = 3
K_VOLUME, K_GRIP, K_LIGHTNESS = range(KINDS)  # rows of `kinds_of`


def kinds_of(scene: Scene, samples: Samples) -> np.ndarray:
    """Return volume, grip and lightness by number, (KINDS, particles and samples) float64.

    See model/formulas/fluid/solids.py; `scene`: of the fluids alone.
    """
    fluids = scene.fluid_set
    kinds = np.zeros((KINDS, fluids.particle_count + samples.count))
    kinds[K_VOLUME] = np.append(np.ones(fluids.particle_count), samples.volume)
    kinds[K_GRIP] = np.append(np.zeros(fluids.particle_count), samples.volume / scene.method.iterations)
    kinds[K_LIGHTNESS] = np.append(np.array(fluids.lightness)[fluids.fluid], samples.mobility)
    return kinds
