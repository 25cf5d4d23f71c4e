"""What a fluid's solvers know of the solids that it meets, beside their samples."""

from __future__ import annotations

import numpy as np

from model.core.errors import SceneError
from model.fluid.samples import Samples
from model.scene.scene import Scene

KINDS = 3
K_VOLUME, K_GRIP, K_LIGHTNESS = range(KINDS)  # rows of `kinds_of`


def kinds_of(scene: Scene, samples: Samples) -> np.ndarray:
    """(KINDS, particles and samples) float64: what each counts for, by number (model/formulas/fluid/solids.py); `scene`: of
    the fluids alone."""
    found = scene.fluid_set
    kinds = np.zeros((KINDS, found.particle_count + samples.count))
    kinds[K_VOLUME] = np.append(np.ones(found.particle_count), samples.volume)
    kinds[K_GRIP] = np.append(np.zeros(found.particle_count), samples.volume / scene.method.iterations)
    kinds[K_LIGHTNESS] = np.append(np.array(found.lightness)[found.fluid], samples.own_lightness)
    return kinds


def check_among_solids(scene: Scene) -> None:
    """Raise SceneError for a fluid that cannot meet solids."""
    name = scene.fluid_set.names[0]
    if scene.dimensions == 2:
        raise SceneError(f"{name}.dimensions", 2, "must be 3 where a fluid meets solids, which lie in space")
    if scene.domain is not None:
        told = "does not go with solids, which know no sides that repeat; leave it out"
        raise SceneError(f"{scene.name_of('domain')}.kind", "domain", told)
    if scene.method.scheme != "macklin":
        raise SceneError("method.scheme", scene.method.scheme, "must be macklin where a fluid meets solids")
