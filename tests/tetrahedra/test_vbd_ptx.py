"""The CUDA kernels of vertex block descent, and the position-based ones of tetrahedra, compile without a GPU where the
compiler is there: no double in float32, no local memory, nothing contracted in exact math."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import kernel_text

from model.core.constraints import Projection
from model.formulas.constraints import tetrahedron

pytestmark = pytest.mark.usefixtures("ptx_compiler")

KERNELS = {"remember": "RIRRi", "start": "RRRRIIiP", "descend": "RRIIIIRRiiiP"}


def text(name: str, real: Any, math: str, material: int, damped: bool = False) -> str:
    from gpu_backend.tetrahedra.descent_kernels import make_visits

    kernel = getattr(make_visits(real, math, material, damped), name)
    return kernel_text(kernel, KERNELS[name], real, math, "descent")


@pytest.mark.parametrize("material", range(len(tetrahedron.MATERIALS)))
@pytest.mark.parametrize("math", ["fast", "exact"])
def test_float32_visits_hold_no_double_and_no_local_memory(math: str, material: int) -> None:
    for name in KERNELS:
        found = text(name, np.float32, math, material, damped=math == "fast")
        assert ".f64" not in found and ".local" not in found and "call" not in found, name


@pytest.mark.parametrize("material", range(len(tetrahedron.MATERIALS)))
def test_exact_visits_contract_nothing(material: int) -> None:
    """In float64, whose quotients are an instruction: no product runs into a sum."""
    found = text("descend", np.float64, "exact", material, damped=True)
    assert "fma.rn.f64" not in found and "mul.rn.f64" in found


def test_who_has_no_damper_reads_no_stresses() -> None:
    """9 + 4 values of a tetrahedron; 6 stresses beside them; of the neo-Hookean material only its damper needs R."""
    plain, damped = (text("descend", np.float32, "fast", tetrahedron.HOOKEAN, one) for one in (False, True))
    assert damped.count("ld.global.f32") - plain.count("ld.global.f32") == 6 + 2  # the time, and 1 / h
    assert "sqrt" not in plain and "sqrt" in damped


@pytest.mark.parametrize("material", range(len(tetrahedron.MATERIALS)))
def test_exact_projections_contract_nothing(material: int) -> None:
    from gpu_backend.core.constraints import make_projections

    projection = Projection(
        "one", tetrahedron.make, 4, tetrahedron.COUNT, 2, flags=(("material", material), ("damped", 0))
    )
    kernel = make_projections(np.float64, "exact", projection)
    found = kernel_text(kernel, "RRIRRiiiiP", np.float64, "exact")
    assert "fma.rn.f64" not in found and "mul.rn.f64" in found
