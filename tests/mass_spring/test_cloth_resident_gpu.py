"""The kernel `resident` of cloths on a real GPU: the CPU's bits in `exact` math, on all kinds of tiles; bounded in `fast`."""

from __future__ import annotations

import pytest
from test_cloth_gpu import assert_same, end_state

from softlab.model.scene.scene import load_scene

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("side", [64, 128, 250, 512])
def test_the_tables_tiles_give_the_bits_of_the_passes(side: int) -> None:
    """Some thousand exchanges, of which one that is missed or comes late would show."""
    scene = load_scene("cloth-hanging").replace({"cloth.rows": side, "cloth.columns": side})
    expected = end_state(scene, "gpu", steps=6000, poke=False, math="exact", kernel="graph")
    assert_same(end_state(scene, "gpu", steps=6000, poke=False, math="exact", kernel="resident"), expected, side)
