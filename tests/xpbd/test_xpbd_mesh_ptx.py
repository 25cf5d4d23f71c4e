"""The CUDA kernels of meshes compile without a GPU where the compiler is there: no double in float32, no local memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of, record_of

from softlab.model.position_based.mesh_constraints import projection_of

AIR = frozenset({"wind", "gust", "external", "gravity", "poke", "damping", "pins", "load", "gauss-seidel"})
SOFT = frozenset({"structural-compliance", "bending-compliance"})
FAMILIES = {
    "edges": ("structural", SOFT),
    "rigid edges": ("structural", frozenset()),
    "damped edges": ("structural", SOFT | {"structural-damping"}),
    "distances": ("bending", SOFT),
    "isometric": ("bending", SOFT | {"bending-isometric"}),
    "dihedral": ("bending", SOFT | {"bending-dihedral"}),
    "attachments": ("attachments", SOFT | {"attachments-2"}),
}


pytestmark = pytest.mark.usefixtures("ptx_compiler")


def ptx(kernel: Any, real: Any, math: str, *arguments: str) -> str:
    """The text of a kernel whose arguments are told in letters: R, I arrays of reals and of indices, P the record (W: of two
    axes), i, l numbers."""
    from numba import types

    scalars = (types.float32 if real is np.float32 else types.float64)[::1]
    known = {"R": scalars, "I": types.int32[::1], "U": types.uint64[::1], "L": types.int64[::1]}
    known["W"] = (types.float32 if real is np.float32 else types.float64)[:, ::1]
    known["P"] = record_of(real, "quads")
    known |= {"i": types.int32, "l": types.int64}
    return entry_of(kernel.py_func, tuple(known[a] for a in "".join(arguments)), math)


def projection(name: str, real: Any, math: str) -> str:
    from softlab.gpu_backend.core.constraints import make_projections

    kind, parts = FAMILIES[name]
    projection = projection_of(kind, parts | {kind})
    return ptx(make_projections(real, math, projection), real, math, "RRIRRiiiiP")


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", FAMILIES)
def test_float32_projections_hold_no_double_and_no_local_memory(name: str, math: str) -> None:
    text = projection(name, np.float32, math)
    assert ".f64" not in text
    assert ".local" not in text and "call" not in text


@pytest.mark.parametrize("name", ["isometric", "dihedral"])
def test_exact_projections_contract_nothing(name: str) -> None:
    """In float64, whose quotients are an instruction: no product runs into a sum."""
    text = projection(name, np.float64, "exact")
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text


def test_multipliers_are_only_there_for_what_gives() -> None:
    soft, rigid = projection("edges", np.float32, "fast"), projection("rigid edges", np.float32, "fast")
    assert soft.count("st.global.f32") == 1 and rigid.count("st.global.f32") == 0
    assert soft.count("st.global.v4.f32") == rigid.count("st.global.v4.f32") == 2
    assert projection("isometric", np.float32, "fast").count("st.global.v4.f32") == 4


@pytest.mark.parametrize("math", ["fast", "exact"])
def test_the_prediction_and_normals_compile(math: str) -> None:
    from softlab.gpu_backend.core.sheet import make_mesh_tools
    from softlab.gpu_backend.position_based.mesh_kernels import make_mesh_begin

    text = ptx(make_mesh_begin(np.float32, math, AIR), np.float32, math, "RRRIIIPULlll")
    assert ".f64" not in text and ".local" not in text
    bare = ptx(make_mesh_begin(np.float32, math, frozenset({"gravity"})), np.float32, math, "RRRIIIPULlll")
    assert "rsqrt" not in bare and "bar.sync" not in bare and bare.count("ld.global.v4.f32") == 2
    assert ".f64" not in ptx(make_mesh_tools(np.float32).write_normal, np.float32, "exact", "RWIII")
