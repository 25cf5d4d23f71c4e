"""The cloth's CUDA kernels compile without a GPU where the compiler is there: no double in float32, no local memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of, record_of

SPRINGS = frozenset({"structural", "shear", "bending"})
PLAIN = SPRINGS | {"damping", "gravity", "pins"}
AIR = frozenset({"wind", "gust", "external"})
BODIES = frozenset({"plane", "sphere", "capsule", "box", "friction"})
EVERYTHING = PLAIN | {f"{kind}-damping" for kind in SPRINGS} | AIR | BODIES | {"poke", "motion"}


pytestmark = pytest.mark.usefixtures("ptx_compiler")


def ptx(kernel: Any, kind: str, real: Any, math: str) -> str:
    """The text of a `pass`, an `rk4` stage or a `block`."""
    from numba import types

    scalars = (types.float32 if real is np.float32 else types.float64)[::1]
    arrays = {"pass": 4, "rk4": 8, "block": 4}[kind]
    constants = (record_of(real, "quads"), scalars, types.uint64[::1], types.int64[::1], types.int64)
    passes = (types.int64,) if kind == "block" else ()
    signature = ((scalars,) * arrays) + constants + passes + (types.int32, types.int32)
    return entry_of(kernel.py_func, signature, math)


def pass_text(name: str, parts: frozenset[str], real: Any = np.float32, math: str = "fast") -> str:
    """The PTX of the pass `name`: of velocity Verlet, or `step` of the hand-out's."""
    from softlab.gpu_backend.mass_spring.cloth.kernels import make_cloth_passes

    integrator = "lab" if name == "step" else "velocity-verlet"
    return ptx(make_cloth_passes(real, math, integrator, parts)[name], "pass", real, math)


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", ["step", "opening", "middle", "closing"])
def test_float32_passes_hold_no_double_and_no_local_memory(name: str, math: str) -> None:
    text = pass_text(name, EVERYTHING, math=math)
    assert ".f64" not in text
    assert ".local" not in text and "call" not in text


@pytest.mark.parametrize("integrator", ["semi-implicit-euler", "explicit-euler", "taylor"])
def test_the_other_integrators_hold_no_double(integrator: str) -> None:
    from softlab.gpu_backend.mass_spring.cloth.kernels import make_cloth_passes

    text = ptx(make_cloth_passes(np.float32, "exact", integrator, PLAIN)["step"], "pass", np.float32, "exact")
    assert ".f64" not in text and ".local" not in text


@pytest.mark.parametrize("math", ["fast", "exact"])
def test_float32_stages_of_rk4_hold_no_double(math: str) -> None:
    from softlab.gpu_backend.mass_spring.cloth.kernels import make_cloth_rk4_stages

    for kernel in make_cloth_rk4_stages(np.float32, math, EVERYTHING):
        text = ptx(kernel, "rk4", np.float32, math)
        assert ".f64" not in text and ".local" not in text


@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet"])
def test_one_block_reads_its_neighbours_from_shared_memory(integrator: str) -> None:
    from softlab.gpu_backend.mass_spring.cloth.block import make_cloth_block

    for parts in (PLAIN, EVERYTHING):
        text = ptx(make_cloth_block(np.float32, "fast", integrator, parts, 256), "block", np.float32, "fast")
        assert ".f64" not in text and ".local" not in text
        assert "ld.shared.v4.f32" in text and "st.shared.v4.f32" in text and "bar.sync" in text
        assert "ld.shared.f32" not in text and "st.shared.f32" not in text
        assert text.count("ld.global.v4.f32") == 2  # a mass's own position and velocity, once


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("name", ["step", "opening"])
def test_exact_math_contracts_nothing(name: str, real: Any) -> None:
    text = pass_text(name, EVERYTHING, real, "exact")
    assert "fma." not in text and "approx" not in text
    assert f"mul.rn.{'f32' if real is np.float32 else 'f64'}" in text


@pytest.mark.parametrize("real,word,each", [(np.float32, "v4.f32", 1), (np.float64, "v2.f64", 2)])
def test_three_axes_come_in_loads_of_16_bytes(real: Any, word: str, each: int) -> None:
    """Twelve neighbours, the mass itself and its velocity: fourteen quads; two are stored."""
    text = pass_text("middle", PLAIN, real)
    assert text.count(f"ld.global.{word}") == 14 * each
    assert text.count(f"st.global.{word}") == 2 * each
    assert f"st.global.{word[3:]}" not in text


def test_an_absent_part_leaves_no_instruction() -> None:
    everything, bare = pass_text("step", EVERYTHING), pass_text("step", frozenset())
    assert "rsqrt" in everything and "rsqrt" not in bare
    assert "3528531795" in everything and "3528531795" not in bare  # the multiplier of the random generator
    assert "bar.sync" in everything and "bar.sync" not in bare  # gusts: one thread of a block computes them
    assert bare.count("ld.global") == 4  # position and velocity, and the two constants of the step
    without_wind = pass_text("step", SPRINGS)
    assert without_wind.count("rsqrt") == 12  # one a spring
    assert pass_text("step", SPRINGS | {"wind"}).count("rsqrt") == 12 + 6 * 2  # a triangle's normal and the air's speed
    for kind in sorted(BODIES - {"friction"}):
        assert pass_text("step", frozenset({kind})).count("ld.global") > 4, kind


def test_friction_is_compiled_in_where_a_body_has_some() -> None:
    from softlab.model.contact.cloth_parameters import B_DYNAMIC, B_STATIC

    smooth, rough = (pass_text("step", parts) for parts in (frozenset({"plane"}), frozenset({"plane", "friction"})))
    for place in (B_STATIC, B_DYNAMIC):
        assert f"+{4 * place}]" in rough and f"+{4 * place}]" not in smooth


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_the_stages_and_tools_compile(real: Any) -> None:
    from numba import types

    from softlab.gpu_backend.core import forces
    from softlab.gpu_backend.core.sheet import make_cloth_tools
    from softlab.gpu_backend.mass_spring.cloth.stages import make_bound_stages, make_force_stages, make_motion_stages

    kind = types.float32 if real is np.float32 else types.float64
    quads, words, record = kind[::1], types.uint64[::1], record_of(real, "quads")
    shape, step = (types.int32, types.int32), types.int64
    tools, variant = make_cloth_tools(real), (real, "fast", "velocity-verlet", EVERYTHING)
    force, motion, bound = make_force_stages(*variant), make_motion_stages(*variant), make_bound_stages(*variant)
    own = forces.make_force_stages(real, "fast", EVERYTHING)
    for kernel, arguments in (
        (tools.count, (types.int64[::1], types.int64)),
        (tools.first_diverged, (quads, quads, kind, kind, kind, kind, types.int32[::1])),
        (tools.write_position, (quads, kind[:, ::1])),
        (tools.write_normal, (quads, kind[:, ::1], *shape)),
        (force.spring_forces, (quads, quads, record, quads, *shape)),
        (force.no_forces, (quads,)),
        (force.wind, (quads, quads, record, words, step, kind, quads, *shape)),
        *((kernel, (quads, record, words, step, quads)) for kernel in own.values()),
        (force.damping, (quads, record, quads)),
        (motion.integrate, (quads, quads, quads, record)),
        (motion.first_kick, (quads, quads, quads, record)),
        (motion.second_kick, (quads, quads, record)),
        (motion.accumulate, (types.int32, quads, quads, quads, record, quads)),
        (bound.collide, (quads, quads, quads, record, quads, words, step)),
        (bound.pins, (quads,) * 3),
        (bound.moving_pins, (quads, quads, record, quads, step, types.int32)),
    ):
        text = entry_of(kernel.py_func, arguments, "exact")
        assert ".local" not in text
        assert real is np.float64 or ".f64" not in text
