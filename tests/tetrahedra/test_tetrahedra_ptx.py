"""The CUDA kernels of tetrahedra compile without a GPU where the compiler is there: no double in float32, no local memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of, record_of

from softlab.model.contact.sheet_plan import FRICTION_IN_PLACE
from softlab.model.formulas.constraints.tetrahedron import MATERIALS
from softlab.model.particles.constraints import Projection
from softlab.model.tetrahedra.constraints import BLOCKS, DAMPED, ITERATED, part_of_run, projections_of

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def text_of(material: str, real: Any, math: str, *more: str) -> str:
    (projection,) = projections_of(frozenset({material, *more} - {""}))
    return projection_text(projection, real, math)


def projection_text(projection: Projection, real: Any, math: str) -> str:
    from numba import types

    from softlab.gpu_backend.core.constraints import make_projections

    reals, i, n = (types.float32 if real is np.float32 else types.float64)[::1], types.int32, types.int32[::1]
    kernel = make_projections(real, math, projection)
    record = record_of(real, "tetrahedra")
    return entry_of(kernel.py_func, (reals, reals, n, reals, reals, i, i, i, i, record), math)


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("parts", [*((name,) for name in MATERIALS), (MATERIALS[0], BLOCKS)])
def test_float32_projections_hold_no_double_and_no_local_memory(parts: tuple[str, ...], math: str) -> None:
    text = text_of(parts[0], np.float32, math, DAMPED, ITERATED, *parts[1:])
    assert ".f64" not in text
    assert ".local" not in text and "call" not in text


@pytest.mark.parametrize("run", [5, 6])
def test_those_of_voxels_are_a_loop(run: int) -> None:
    text = text_of("fixed-corotated", np.float32, "fast", DAMPED, ITERATED, part_of_run("fixed-corotated", run))
    one = text_of("fixed-corotated", np.float32, "fast", DAMPED, ITERATED)
    assert ".f64" not in text and ".local" not in text and "call" not in text
    assert text.count("sqrt") == one.count("sqrt")  # not the code of each tetrahedron


@pytest.mark.parametrize("material", MATERIALS)
def test_exact_projections_contract_nothing(material: str) -> None:
    """In float64, whose quotients are an instruction: no product runs into a sum."""
    text = text_of(material, np.float64, "exact", ITERATED)
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text


@pytest.mark.parametrize("real,math", [(np.float32, "fast"), (np.float64, "exact")])
def test_volumes_of_voxels_compile_likewise(real: Any, math: str) -> None:
    parts = frozenset({"neo-hookean", DAMPED, ITERATED, part_of_run("neo-hookean", 5, True)})
    for projection in projections_of(parts):  # of shapes, and of volumes
        text = projection_text(projection, real, math)
        assert ".local" not in text and "call" not in text
        assert ".f64" not in text if real is np.float32 else "fma.rn.f64" not in text


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("material", MATERIALS)
def test_the_resident_kernel_holds_no_double_and_no_local_memory(material: str, math: str) -> None:
    text = resident_text(material, np.float32, math, DAMPED, ITERATED, "gravity", "damping", "pins", "load")
    assert ".f64" not in text
    assert ".local" not in text and "call" not in text
    assert "st.relaxed.gpu.global.b128" in text and "ld.shared.v4.f32" in text


def test_the_resident_kernel_contracts_nothing_in_exact_math() -> None:
    text = resident_text("corotated", np.float64, "exact", ITERATED, "gravity", "load")
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text


def resident_text(material: str, real: Any, math: str, *more: str) -> str:
    from numba import types

    from softlab.gpu_backend.tetrahedra.resident import make_tetrahedra_resident

    parts = frozenset({material, part_of_run(material, 5), *more})
    (projection,) = projections_of(parts)
    reals, i, n = (types.float32 if real is np.float32 else types.float64)[::1], types.int32, types.int32[::1]
    kernel, long = make_tetrahedra_resident(real, math, parts, projection), types.int64
    arguments = (
        reals, reals, reals, reals, n, n, reals, reals, reals, i, i, n, record_of(real, "tetrahedra"), reals,
        types.uint64[::1], types.int64[::1], i, i, i, i, long, long, i,
    )  # fmt: skip
    return entry_of(kernel.py_func, arguments, math)


def test_blocks_compile_likewise() -> None:
    text = text_of("fixed-corotated", np.float32, "fast", DAMPED, ITERATED, BLOCKS)
    assert ".f64" not in text and ".local" not in text and "call" not in text
    text = text_of("corotated", np.float64, "exact", ITERATED, BLOCKS)
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text


def test_multipliers_are_only_there_where_they_are_kept() -> None:
    once, kept = (text_of("fixed-corotated", np.float32, "fast", *more) for more in ((), (ITERATED,)))
    assert once.count("st.global.f32") == 0 and kept.count("st.global.f32") == 2


@pytest.mark.parametrize("real,math", [(np.float32, "fast"), (np.float32, "exact"), (np.float64, "exact")])
def test_colliders_in_iterations_compile_likewise(real: Any, math: str) -> None:
    from numba import types

    from softlab.gpu_backend.position_based.touching import make_touching

    reals, wide = (types.float32 if real is np.float32 else types.float64)[::1], types.int64
    parts = frozenset({"gravity", "load", "pins", "plane", "sphere", "friction", "restitution", FRICTION_IN_PLACE})
    kernels = make_touching(real, math, parts)
    time = types.int64[::1], wide, wide, wide
    arguments = reals, reals, reals, record_of(real, "tetrahedra"), reals, types.uint64[::1], *time
    for kernel, given in ((kernels.touch, arguments), (kernels.release, (reals, reals))):
        body = entry_of(kernel.py_func, given, math)
        assert ".local" not in body and "call" not in body
        assert ".f64" not in body if real is np.float32 else "fma.rn.f64" not in body


@pytest.mark.parametrize("real,math", [(np.float32, "fast"), (np.float32, "exact"), (np.float64, "exact")])
def test_pins_that_move_compile_likewise(real: Any, math: str) -> None:
    from numba import types

    from softlab.gpu_backend.contact.pins import make_drive

    reals = (types.float32 if real is np.float32 else types.float64)[::1]
    i, n, wide = types.int32, types.int32[::1], types.int64
    arguments = reals, reals, record_of(real, "tetrahedra"), reals, n, i, i, wide[::1], wide, wide, wide
    body = entry_of(make_drive(real, math).py_func, arguments, math)
    assert ".local" not in body and "call" not in body
    assert ".f64" not in body if real is np.float32 else "fma.rn.f64" not in body


@pytest.mark.parametrize("real,math", [(np.float32, "fast"), (np.float64, "exact")])
def test_bodies_that_are_slowed_compile_likewise(real: Any, math: str) -> None:
    from numba import types

    from softlab.gpu_backend.position_based.mesh_kernels import make_slow

    reals = (types.float32 if real is np.float32 else types.float64)[::1]
    body = entry_of(make_slow(real, math).py_func, (reals, reals, record_of(real, "tetrahedra")), math)
    assert ".local" not in body and (".f64" not in body if real is np.float32 else "fma.rn.f64" not in body)


@pytest.mark.parametrize("model", ["world", "bodies", "cloth"])
def test_attachments_compile_likewise(model: str) -> None:
    for real, math in ((np.float32, "fast"), (np.float64, "exact")):
        text = text_of("", real, math, ITERATED, f"attachment-{model}")
        assert ".local" not in text and "call" not in text
        assert ".f64" not in text if real is np.float32 else "fma.rn.f64" not in text
