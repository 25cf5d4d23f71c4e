"""The CUDA kernels of clusters that do more than turn compile without a GPU where the compiler is there: no double in
float32, no local memory."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from kernel_text import kernel_text

PARTS = frozenset({"gravity", "poke", "damping", "load", "plane", "friction", "linear", "plastic", "cluster_damping"})
LETTERS = {  # of each kernel's arguments, see kernel_text.py
    "turn": "RIRRRRRRRR",
    "gather": "RRIIIRRR",
    "rate": "RRRIIRRP",
    "slow": "RRIIRR",
    "finish": "RRRIIRRPRULlll",
}

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def ptx(name: str, real: Any, math: str) -> str:
    from softlab.gpu_backend.shape_matching.damping import make_damping_ends, make_gather
    from softlab.gpu_backend.shape_matching.shapes import make_shaped_turn
    from softlab.model.shape_matching.cluster_tables import shaping

    made = SimpleNamespace(
        turn=make_shaped_turn(real, math, shaping(PARTS)), gather=make_gather(real, math),
        **vars(make_damping_ends(real, math, PARTS)),
    )  # fmt: skip
    return kernel_text(getattr(made, name), LETTERS[name], real, math)


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", LETTERS)
def test_float32_holds_no_double_and_no_local_memory(name: str, math: str) -> None:
    text = ptx(name, np.float32, math)
    assert ".f64" not in text
    assert ".local" not in text and "call" not in text


@pytest.mark.parametrize("name", ["turn", "gather", "slow"])
def test_exact_kernels_contract_nothing(name: str) -> None:
    """In float64, whose quotients are an instruction: no product runs into a sum."""
    text = ptx(name, np.float64, "exact")
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text


def test_momenta_meet_in_shared_memory() -> None:
    """A number a lane, then one of each sum; behind two barriers one thread makes the motion of them, in three quads."""
    text = ptx("gather", np.float32, "fast")
    assert text.count("bar.sync") == 2 and text.count("st.shared") == 16 and text.count("st.global.v4.f32") == 3
