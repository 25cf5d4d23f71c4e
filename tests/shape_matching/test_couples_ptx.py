"""The CUDA code of friction's couples, without a GPU."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_text import kernel_text

LETTERS = {"gather": "RRIIIRRR", "turn": "RRIIRR"}

pytestmark = pytest.mark.usefixtures("ptx_compiler")


@pytest.mark.parametrize("has_rigid", [False, True])
@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", LETTERS)
def test_float32_holds_no_double_and_no_local_memory(name: str, math: str, has_rigid: bool) -> None:
    """A turn writes a couple, a place and a travel, as quads."""
    from softlab.gpu_backend.shape_matching.couples import make_couples

    letters = LETTERS[name] + "R" * (has_rigid and name == "turn")
    text = kernel_text(getattr(make_couples(np.float32, math, has_rigid), name), letters, np.float32, math)
    assert ".f64" not in text and ".local" not in text
    assert text.count("st.global.v4.f32") == 2 + (has_rigid and name == "turn")


@pytest.mark.parametrize("name", LETTERS)
def test_exact_kernels_contract_nothing(name: str) -> None:
    from softlab.gpu_backend.shape_matching.couples import make_couples

    text = kernel_text(getattr(make_couples(np.float64, "exact", False), name), LETTERS[name], np.float64, "exact")
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text
