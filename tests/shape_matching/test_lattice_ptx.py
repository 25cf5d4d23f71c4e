"""The CUDA kernels of lattices compile without a GPU where the compiler is there: no double in float32, no local memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import kernel_text

LETTERS = {  # of each kernel's arguments, see kernel_text.py
    "sum_lines": "IRRiRR",
    "sum_slices": "IRRiRRRi",
    "sum_windows": "IRRiRRRi",
    "turn": "IRRiRRRRRb",
    "goal_slices": "IRRiRRRi",
    "goal_lines": "IRRiRRRi",
    "move_lines": "IRRiRR",
}

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def ptx(name: str, real: Any, math: str) -> str:
    from softlab.gpu_backend.shape_matching.lattice_kernels import make_lattice_kernels

    return kernel_text(getattr(make_lattice_kernels(real, math), name), LETTERS[name], real, math)


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", LETTERS)
def test_float32_holds_no_double_and_no_local_memory(name: str, math: str) -> None:
    text = ptx(name, np.float32, math)
    assert ".f64" not in text
    assert ".local" not in text and "call" not in text


@pytest.mark.parametrize("name", LETTERS)
def test_exact_kernels_contract_nothing(name: str) -> None:
    """In float64, whose quotients are an instruction: no product runs into a sum."""
    text = ptx(name, np.float64, "exact")
    assert "fma" not in text and ".f64" in text
