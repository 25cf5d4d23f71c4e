"""One mass and one collider by the CUDA device functions, in plain Python, against what is worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from collider_touch import CASES, STEP, numbers_of, record, scene_of
from numba import cuda

from softlab.gpu_backend.contact import colliders
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import BOXES, CAPSULES, INTEGERS, PLANES, SPHERES
from softlab.gpu_backend.core.world import World
from softlab.model.base.variant import features_of
from softlab.model.contact.sheet_plan import cloth_parts

COUNTED = {"plane": PLANES, "sphere": SPHERES, "capsule": CAPSULES, "box": BOXES}


@pytest.mark.parametrize("real", [np.float64, np.float32])
@pytest.mark.parametrize("name", CASES)
def test_one_mass_meets_a_collider_on_the_gpu(name: str, real: type) -> None:
    kind, table, (before, position, velocity), expected = CASES[name]
    scene = scene_of(kind, table)
    collide = device_variant(real, "exact", features_of(cloth_parts(scene)))(colliders.collide)
    found = np.zeros(6, real)

    @cuda.jit
    def kernel(before, given, record, bodies, integers, out):
        made = collide(
            before, given[0], given[1], given[2], given[3], given[4], given[5], World(record[0], bodies, integers), STEP
        )
        for k in range(6):
            out[k] = made[k]

    integers = np.zeros(INTEGERS, np.uint64)
    integers[COUNTED[kind]] = 1
    given = np.array([*position, *velocity], real)
    kernel[1, 1](np.array(before, real), given, record(real), numbers_of(scene, real), integers, found)
    assert found == pytest.approx([*expected[0], *expected[1]], abs=1e-6)
