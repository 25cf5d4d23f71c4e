"""The CUDA kernels of bodies compile without a GPU where the compiler is there: no double in float32, no local memory."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from kernel_text import kernel_text

from softlab.model.particles.links import LINKS

PARTS = frozenset({"gravity", "poke", "damping", "load", "plane", "friction"})
LETTERS = {  # of each kernel's arguments, see kernel_text.py
    "sum_up": "RIIIRR",
    "turn": "RIRRRRR",
    "move": "RIIRR",
    "begin": "RRRPU",
    "finish": "RRRIIRRPRULlll",
    "project": "RRIRRiiiiP",
}


pytestmark = pytest.mark.usefixtures("ptx_compiler")


def ptx(name: str, real: Any, math: str) -> str:
    from softlab.gpu_backend.core.constraints import make_projections
    from softlab.gpu_backend.shape_matching.kernels import make_bodies_clusters, make_bodies_ends

    made = SimpleNamespace(**vars(make_bodies_clusters(real, math)), **vars(make_bodies_ends(real, math, PARTS)))
    made.project = make_projections(real, math, LINKS)
    return kernel_text(getattr(made, name), LETTERS[name], real, math)


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", LETTERS)
def test_float32_holds_no_double_and_no_local_memory(name: str, math: str) -> None:
    text = ptx(name, np.float32, math)
    assert ".f64" not in text
    assert ".local" not in text and "call" not in text


@pytest.mark.parametrize("name", ["sum_up", "turn", "move"])
def test_exact_kernels_contract_nothing(name: str) -> None:
    """In float64, whose quotients are an instruction: no product runs into a sum."""
    text = ptx(name, np.float64, "exact")
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text


def test_particles_are_read_once_as_quads() -> None:
    """A member is two accesses and an index; sums meet in shared memory behind one barrier."""
    text = ptx("sum_up", np.float32, "fast")
    assert text.count("bar.sync") == 1 and text.count("st.shared") == 12 and text.count("st.global") == 1
    assert ptx("finish", np.float32, "fast").count("st.global.v4.f32") == 2
