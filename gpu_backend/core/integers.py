"""Integers that kernels of quads read besides the record: seeds, the poked mass, the number of colliders of each
kind."""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import FEATURE, inlined_routine
from softlab.model.core.own_forces import EXTERNAL_SEED, particle_forces_change
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import COLLIDER_KINDS

INTEGERS = 9
# after EXTERNAL_SEED and POKED
WIND_SEED, PLANES, SPHERES, CAPSULES, BOXES, MESHES, FIELDS = range(2, INTEGERS)
COUNTS = (PLANES, SPHERES, CAPSULES, BOXES, MESHES, FIELDS)
COLLIDER_COUNTS = tuple(zip(COUNTS, COLLIDER_KINDS, strict=True))  # index, kind
COLLIDERS = frozenset(COLLIDER_KINDS)


def knows_time(parts: frozenset[str]) -> bool:
    """Return True if anything depends on the number of the step."""
    return bool(particle_forces_change(parts) or parts & {"gust", "motion", "emitter"} or parts & COLLIDERS)


def integers_of(scene: Scene) -> np.ndarray:
    """Return (INTEGERS,) uint64, with nothing poked."""
    integers = np.zeros(INTEGERS, np.uint64)
    integers[EXTERNAL_SEED] = scene.external.seed if scene.external else 0
    integers[WIND_SEED] = scene.wind.seed if scene.wind else 0
    kinds = [kind for kind, _ in scene.colliders]
    for place, kind in COLLIDER_COUNTS:
        integers[place] = kinds.count(kind)
    return integers


@inlined_routine
def clock(counter, place, substeps, substep):
    """Return (the step's number, the substep's), 0 if nothing depends on time; `place`: of the step after the
    counter."""
    if FEATURE.timed:
        step = counter[0] + place
        return step, step * substeps + substep
    return np.int64(0), np.int64(0)
