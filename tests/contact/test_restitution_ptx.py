"""The CUDA kernel in which bodies meet colliders that give back compiles without a GPU where the compiler is there."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_text import collide_text
from test_bodies_ptx import PARTS

from softlab.model.contact.cloth_parameters import B_RESTITUTION

pytestmark = pytest.mark.usefixtures("ptx_compiler")
BOUNCES = PARTS | {"restitution"}


@pytest.mark.parametrize("math", ["fast", "exact"])
def test_float32_holds_no_double_and_no_local_memory(math: str) -> None:
    for parts in (BOUNCES, BOUNCES - {"plane"} | {"mesh_collider"}):
        text = collide_text(np.float32, math, parts)
        assert ".f64" not in text
        assert ".local" not in text and "call" not in text


def test_exact_math_contracts_nothing() -> None:
    text = collide_text(np.float64, "exact", BOUNCES)
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text


def test_it_is_compiled_in_where_a_collider_gives_back() -> None:
    place = f"+{4 * B_RESTITUTION}]"
    assert place in collide_text(np.float32, "fast", BOUNCES) and place not in collide_text(np.float32, "fast", PARTS)
