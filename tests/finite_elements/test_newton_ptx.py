"""The CUDA kernel of implicit tetrahedral bodies compiles without a GPU where the compiler is there: no double in float32, no
local memory, no function that is called, nothing contracted in exact math."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of

from softlab.model.contact.sheet_plan import FRICTION_IN_PLACE
from softlab.model.contact.substep_parameters import XPBD_PARAMETERS
from softlab.model.core.parameters import record_type
from softlab.model.position_based.mesh_plan import BODY_DAMPING
from softlab.model.tetrahedra.newton import CONSTANTS, DAMPED, STAGED
from softlab.model.tetrahedra.springs import PARTS

pytestmark = pytest.mark.usefixtures("ptx_compiler")

FREE = frozenset({"gravity", "load"})
EVERYTHING = FREE | {DAMPED, "pins", "damping", "external", "poke", "plane", "sphere", "capsule", "box", "friction"}
EVERYTHING |= {FRICTION_IN_PLACE}
STAGES = FREE | {DAMPED, STAGED}
PINS = FREE | {DAMPED, "pins", "motion", BODY_DAMPING} | PARTS


def text(real: Any, math: str, parts: frozenset[str]) -> str:
    """From its entry on."""
    from numba import typeof, types

    from softlab.gpu_backend.tetrahedra.newton_kernel import make_newton

    one = types.float32 if real is np.float32 else types.float64
    reals, whole, wide = one[::1], types.int32[::1], types.int64[::1]
    record = typeof(np.zeros(1, record_type((*CONSTANTS, *XPBD_PARAMETERS), real)))
    arguments = (
        *(reals,) * 14, whole, reals, whole, wide, record, reals, types.uint64[::1], wide, types.int64, types.int64,
        types.int64, one,
    )  # fmt: skip
    return entry_of(make_newton(real, math, parts).py_func, arguments, math)


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("parts", [FREE, EVERYTHING, PINS, STAGES], ids=["free", "everything", "pins", "stages"])
def test_float32_holds_no_double_and_no_local_memory(parts: frozenset[str], math: str) -> None:
    found = text(np.float32, math, parts)
    assert ".f64" not in found
    assert ".local" not in found and "call" not in found


def test_exact_math_contracts_nothing() -> None:
    """In float64, whose quotients are an instruction: no product runs into a sum."""
    found = text(np.float64, "exact", EVERYTHING - {"external"})
    assert "fma.rn.f64" not in found and "mul.rn.f64" in found
