"""The kernels that sort a fluid's particles compile for a GPU without one: no double in float32, no local memory, no
atomics but on whole numbers."""

from __future__ import annotations

import re

import numpy as np
import pytest
from kernel_text import kernel_text

SORT = {  # of each kernel's arguments, see kernel_text.py
    "bound": "RrR",
    "span": "RRIiRI",
    "hash_particles": "RRIIII",
    "chunks": "IIII",
    "totals": "II",
    "fill": "IIIIIIIII",
    "arrange": "IIIRRRIRRRII",
}
ATOMICS = {"hash_particles"}

pytestmark = pytest.mark.usefixtures("ptx_compiler")


@pytest.mark.parametrize("name", SORT)
def test_sorting(name: str) -> None:
    from gpu_backend.fluid.sort_kernels import make_cell_sort

    text = kernel_text(getattr(make_cell_sort(np.float32), name), SORT[name], np.float32, "exact")
    assert ".f64" not in text and ".local" not in text and "call" not in text and "fma" not in text
    atomics = re.findall(r"\b(?:atom|red)\.\S+", text)
    assert bool(atomics) == (name in ATOMICS)
    assert all(word.endswith((".u32", ".s32")) for word in atomics)
