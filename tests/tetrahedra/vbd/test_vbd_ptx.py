"""The CUDA kernels of vertex block descent compile without a GPU where the compiler is there: no double in float32, no local
memory, nothing contracted in exact math."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of

from softlab.model.contact.substep_parameters import XPBD_PARAMETERS
from softlab.model.core.parameters import record_type
from softlab.model.formulas.constraints import tetrahedron
from softlab.model.tetrahedra import springs
from softlab.model.tetrahedra.descent import SCALE
from softlab.model.tetrahedra.newton import CONSTANTS

pytestmark = pytest.mark.usefixtures("ptx_compiler")

PARTS = springs.PARTS | {"plane", "box", "friction"}
KERNELS = {"remember": "RIRRi", "start": "RRRRIIiP", "descend": "RRIIIIRRIIIRRRiiiPRUWwww"}


def text(name: str, real: Any, math: str, material: int, damped: bool = False, parts: frozenset[str] = PARTS) -> str:
    """Of a kernel from its entry on. R and I: arrays of reals and of indices, P the record, i a number."""
    from numba import typeof, types

    from softlab.gpu_backend.tetrahedra.descent_kernels import make_visits

    kernel = getattr(make_visits(real, math, material, damped, parts), name)
    known = {
        "R": (types.float32 if real is np.float32 else types.float64)[::1],
        "I": types.int32[::1],
        "i": types.int32,
        "U": types.uint64[::1],
        "W": types.int64[::1],
        "w": types.int64,
    }
    known["P"] = typeof(np.zeros(1, record_type((SCALE, *CONSTANTS, *XPBD_PARAMETERS), real)))
    return entry_of(kernel.py_func, tuple(known[letter] for letter in KERNELS[name]), math)


@pytest.mark.parametrize("material", range(len(tetrahedron.MATERIALS)))
@pytest.mark.parametrize("math", ["fast", "exact"])
def test_float32_visits_hold_no_double_and_no_local_memory(math: str, material: int) -> None:
    for name in KERNELS:
        found = text(name, np.float32, math, material, damped=math == "fast")
        assert ".f64" not in found and ".local" not in found and "call" not in found, name


def test_acceleration_holds_no_double_and_no_local_memory() -> None:
    from numba import cuda, types

    from softlab.gpu_backend.tetrahedra.descent_kernels import make_accelerate

    arguments = types.float32[::1], types.float32[::1], types.float32
    found, _ = cuda.compile_ptx(make_accelerate(np.float32, "exact").py_func, arguments, cc=(9, 0))
    assert ".f64" not in found and ".local" not in found and "call" not in found[found.index(".entry") :]


@pytest.mark.parametrize("material", range(len(tetrahedron.MATERIALS)))
def test_exact_visits_contract_nothing(material: int) -> None:
    """In float64, whose quotients are an instruction: no product runs into a sum."""
    found = text("descend", np.float64, "exact", material, damped=True)
    assert "fma.rn.f64" not in found and "mul.rn.f64" in found


def test_who_has_no_damper_reads_no_strains() -> None:
    """9 + 4 values of a tetrahedron; 6 strains beside them; the neo-Hookean material needs no R, nor does its damper."""
    plain, damped = (
        text("descend", np.float32, "fast", tetrahedron.HOOKEAN, one, frozenset()) for one in (False, True)
    )
    assert damped.count("ld.global.f32") - plain.count("ld.global.f32") == 6 + 2  # the time, and 1 / h
    assert "sqrt" not in plain and "sqrt" not in damped
