"""The kernels of fluids compile for a GPU without one: no double in float32, no local memory, no atomics but on whole
numbers, and in exact math nothing is contracted."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from kernel_text import kernel_text

SORT = {  # of each kernel's arguments, see kernel_text.py
    "bound": "RrR",
    "span": "RFiRI",
    "hash_particles": "RRIIII",
    "chunks": "IIII",
    "totals": "II",
    "fill": "IIIIIIIII",
    "arrange": "IIIRRRIRRRII",
}
TIME = "RULlll"  # bodies, integers, counter, place, substeps, substep
STEP = {
    "begin": "RRIrFR" + TIME + "RRRRL",
    "find": "RFIIIIIL",
    "prepare": "RFIIIIILRRRRR" + TIME + "R",
    "factors": "RFIIRRRRR" + TIME,
    "density": "RFIIRRRR" + TIME,
    "correct": "RRFIIRR" + TIME + "R",
    "settle": "RRRFIIRRRR" + TIME + "RR",
    "update": "RRRFRR" + TIME + "RR",
    "limit": "RRRFR",
    "shape": "RRFIIRR",
    "smooth": "RRFIIRRRRR",
}
FLOW = {
    "due": "LlllFRIR",
    "rank": "IIII",
    "totals": "II",
    "emit": "RRIIIRRIRII",
    "arrive": "IIIRIRIIL",
    "take": "RIRIRIIII",
    "rest": "III",
}
SOLIDS = {
    "sample": "IiIRRRRRR",
    "gather": "IiI",
    "follow": "IIRRR",
    "push": "RIIRRR",
    "factors": "RFIIIiRRRRRR" + TIME,
    "density": "RFIIIiRRRRR" + TIME,
    "correct": "RRFIIIiRRR" + TIME + "RR",
}
FREE = {  # of the scheme divergence-free
    "gather": "RFR",
    "survey": "RRFIIRRR" + TIME,
    "relax": "RRFIIRRRRRii",
    "push": "RRFIIRRRi",
    "take_up": "RRRFR",
    "accelerate": "RRIRFR" + TIME[1:] + "RL",
    "foresee": "RRFIIRRR",
    "move": "RRRRRFR" + TIME + "RR",
}
COUNTED = {"hash_particles", "find", "prepare", "take", "begin", "accelerate"}  # by atomics
PLAIN = frozenset({"gravity", "plane", "walls"})
ALL = PLAIN | {
    "fluids", "repeats", "averaged", "tensile", "sphere", "capsule", "box", "friction", "restitution", "drag", "held-back",
    "viscosity", "cohesion", "surface-tension", "vorticity", "poke", "external",
}  # fmt: skip
COMING = PLAIN | {
    "fluids",
    "capsule",
    "box",
    "swept",
    "mesh_collider",
    "distance_field",
    "emitter",
    "sink",
    "viscosity",
}

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def counts_alone(text: str, name: str) -> bool:
    """Whether atomics are there where particles are counted, and on whole numbers."""
    atomics = re.findall(r"\b(?:atom|red)\.\S+", text)
    return bool(atomics) == (name in COUNTED) and all(word.endswith((".u32", ".s32", ".u64")) for word in atomics)


def stays_in_registers(text: str) -> bool:
    return ".f64" not in text and ".local" not in text and "call" not in text


@pytest.mark.parametrize("name", SORT)
def test_sorting(name: str) -> None:
    from softlab.gpu_backend.fluid.sort_kernels import make_cell_sort

    kernels = make_cell_sort(np.float32, frozenset("x") if name == "span" else frozenset())
    text = kernel_text(getattr(kernels, name), SORT[name], np.float32, "exact")
    assert stays_in_registers(text) and counts_alone(text, name) and "fma" not in text


def kernel(name: str, real: Any, math: str, parts: frozenset[str]) -> Any:
    from softlab.gpu_backend.fluid.kernels import make_density_kernels
    from softlab.gpu_backend.fluid.motion import make_begin, make_settle
    from softlab.gpu_backend.fluid.smoothing import make_smoothing

    repeats = frozenset("xz") if "repeats" in parts else frozenset()
    if name == "begin":
        return make_begin(real, math, parts, repeats)
    if name in ("settle", "update", "limit"):
        return getattr(make_settle(real, math, parts, repeats), name)
    if name in ("shape", "smooth"):
        return getattr(make_smoothing(real, math, parts, repeats, True), name)
    return getattr(make_density_kernels(real, math, parts, repeats, 64), name)


@pytest.mark.parametrize("parts", [PLAIN, ALL, COMING], ids=["plain", "all", "coming"])
@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", STEP)
def test_a_substep(name: str, math: str, parts: frozenset[str]) -> None:
    text = kernel_text(kernel(name, np.float32, math, parts), STEP[name], np.float32, math)
    assert stays_in_registers(text) and counts_alone(text, name)


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", FLOW)
def test_what_comes_and_ends(name: str, math: str) -> None:
    from softlab.gpu_backend.fluid.flow_kernels import make_flow_kernels

    text = kernel_text(getattr(make_flow_kernels(np.float32, math, COMING), name), FLOW[name], np.float32, math)
    assert stays_in_registers(text) and counts_alone(text, name)


@pytest.mark.parametrize("name", ["totals", "fill", "arrange"])
def test_sorting_what_comes_and_ends(name: str) -> None:
    from softlab.gpu_backend.fluid.sort_kernels import make_cell_sort

    text = kernel_text(getattr(make_cell_sort(np.float32, frozenset(), True), name), SORT[name], np.float32, "exact")
    assert stays_in_registers(text) and counts_alone(text, name)


@pytest.mark.parametrize("name", STEP)
def test_exact_kernels_contract_nothing(name: str) -> None:
    """In float64, whose quotients and roots are instructions: no product runs into a sum."""
    text = kernel_text(kernel(name, np.float64, "exact", ALL), STEP[name], np.float64, "exact")
    assert "fma.rn.f64" not in text


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", SOLIDS)
def test_solids(name: str, math: str) -> None:
    from softlab.gpu_backend.fluid.solids import make_sampling, make_solid_kernels

    parts = (ALL - {"repeats", "averaged"}) | {"solids"}
    for real in (np.float32, np.float64):
        made = vars(make_sampling(real, math)) | vars(make_solid_kernels(real, math, parts))
        text = kernel_text(made[name], SOLIDS[name], real, math)
        assert "call" not in text and "atom" not in text and ".local" not in text
        assert ".f64" not in text or real is np.float64
        assert "fma.rn" not in text or math == "fast" or real is np.float32


@pytest.mark.parametrize("parts", [PLAIN, ALL - {"averaged", "tensile"} | {"moving"}], ids=["plain", "all"])
@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", FREE)
def test_velocities_without_divergence(name: str, math: str, parts: frozenset[str]) -> None:
    from softlab.gpu_backend.fluid.divergence import make_solve, make_targets
    from softlab.gpu_backend.fluid.divergence_motion import make_free_motion

    parts, repeats = parts | {"divergence-free"}, frozenset("xz") if "repeats" in parts else frozenset()
    for real in (np.float32, np.float64):
        variant = real, math, parts, repeats
        made = vars(make_targets(*variant)) | vars(make_solve(*variant)) | vars(make_free_motion(*variant))
        text = kernel_text(made[name], FREE[name], real, math)
        assert "call" not in text and ".local" not in text and counts_alone(text, name)
        assert ".f64" not in text or real is np.float64
        assert "fma.rn" not in text or math == "fast" or real is np.float32
