"""Records of constants: none is the beginning of another. Numba takes the longer one for a kind of the shorter one, and warns
of it on the terminal (NumbaExperimentalFeatureWarning), where both are compiled in one process."""

from __future__ import annotations

import numpy as np

from softlab.model.base.clock import START
from softlab.model.core.families import family_of
from softlab.model.scene.scene import load_scene

SCENES = (  # of every family, in a plane and in space
    "lab-grid", "cloth-sphere", "cloth-hanging", "lab-water", "taylor-green", "column", "fountain",
    "jelly-grid", "rope-stiff", "cloth-xpbd",
)  # fmt: skip


def test_no_record_is_the_beginning_of_another() -> None:
    names = {}
    for scene in map(load_scene, SCENES):
        record = family_of(scene).record(scene, np.float64, (0.0,) * scene.dimensions, START)
        names.setdefault(record.dtype.names, scene.name)
    assert len(names) > 3
    pairs = [(names[a], names[b]) for a in names for b in names if len(a) < len(b) and b[: len(a)] == a]
    assert not pairs
