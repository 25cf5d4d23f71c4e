"""The CUDA kernel in which bodies meet a mesh compiles without a GPU where the compiler is there."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_text import collide_text
from test_bodies_ptx import PARTS

from softlab.model.contact.sheet_plan import FRICTION_IN_PLACE

pytestmark = pytest.mark.usefixtures("ptx_compiler")
MESH = PARTS - {"plane"} | {"mesh_collider"}


@pytest.mark.parametrize("math", ["fast", "exact"])
def test_float32_holds_no_double_and_no_local_memory(math: str) -> None:
    """The walk needs no stack: nothing lies in local memory, and all of it is one function."""
    text = collide_text(np.float32, math, MESH)
    assert ".f64" not in text
    assert ".local" not in text and "call" not in text


def test_exact_math_contracts_nothing() -> None:
    text = collide_text(np.float64, "exact", MESH)
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text


@pytest.mark.parametrize("kinds", [{"plane", "sphere"}, {"mesh_collider"}, {"distance_field"}])
def test_friction_in_place_compiles_likewise(kinds: set[str]) -> None:
    """With a step beside the speed that settles, and a rebound or not."""
    parts = frozenset(PARTS - {"plane"} | kinds | {"friction", FRICTION_IN_PLACE})
    for real, math, more in ((np.float32, "fast", {"restitution"}), (np.float64, "exact", set())):
        text = collide_text(real, math, parts - {"restitution"} | more)
        assert ".local" not in text and "call" not in text
        assert ".f64" not in text if real is np.float32 else "fma.rn.f64" not in text
