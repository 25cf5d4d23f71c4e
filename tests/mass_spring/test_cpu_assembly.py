"""The machine code of the CPU's kernels: loops along a row are vectors, in the kernel's own arithmetic, and stand alone.

A loop along a row is an innermost loop without a branch inside: one block of instructions that ends by jumping to its own
beginning. Which of those is the hot one shows from the roots in it: two springs a mass. Rows are whole blocks of columns
(cpu_backend/core/layout.py), so that there is no loop for a remainder and, since no array overlaps another, no second,
scalar version of the loop behind a check: in `fused` and `team` not one scalar root may be left anywhere. `tiled` has one
place for it: the spring at a tile's left edge, once a row, outside of all loops along rows.
"""

import platform
import re
from types import SimpleNamespace

import llvmlite.binding
import numba
import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.cpu_backend.mass_spring.grid import solver as mass_spring
from softlab.cpu_backend.mass_spring.grid.choice import Tiling
from softlab.model.scene.scene import load_scene

PACKED_ROOT = r"\bv?r?sqrt(14|28)?p[sd]\b"
SCALAR_ROOT = r"\bv?r?sqrt(14|28)?s[sd]\b"
DOUBLE = r"\bv(add|sub|mul|div|sqrt|max|min|fn?m(add|sub)\d+)[ps]d\b|\bvcvt(ps2pd|ss2sd|pd2ps|sd2ss)x?\b"
MAKERS = {"fused": "make_advance", "team": "make_team_advance", "tiled": "make_tiled_advance"}


@pytest.fixture(autouse=True)
def vector_units():
    if platform.machine().lower() not in ("x86_64", "amd64"):
        pytest.skip(f"reads x86-64 assembly, this is {platform.machine()}")
    name = numba.config.CPU_NAME
    if name is None and not llvmlite.binding.get_host_cpu_features().get("avx2"):
        pytest.skip("needs a processor with AVX2")


def assembly(kernel: str, precision: str, math: str) -> str:
    """What a simulation's kernel is compiled to, anew: machine code from the cache cannot be read."""
    scene = load_scene("lab-grid").replace({"grid.rows": 8, "grid.columns": 40})
    with open_simulation(scene, kernel="fused", precision=precision, math=math, threads=2) as simulation:
        assert isinstance(simulation, mass_spring.MassSpring)
        arguments = list(simulation._passes(0, 1))
        parts = simulation.plan.parts
    if kernel == "team":
        arguments += [np.zeros((2, 16), np.int64)]
    elif kernel == "tiled":
        arguments += [Tiling(12, 64, 16, 112, 0)]
    make = getattr(mass_spring, MAKERS[kernel]).__wrapped__  # past the memory of kernels made before
    dispatcher = make(np.dtype(precision).type, math, "lab", parts)
    dispatcher._cache = numba.core.caching.NullCache()
    dispatcher.compile((numba.int64, numba.typeof(tuple(arguments))))  # bands, and what each member is given
    (compiled,) = dispatcher.overloads.values()
    return compiled.library.get_asm_str()


def row_loops(text: str) -> list[str]:
    """Blocks that jump back to their own label."""
    blocks = re.split(r"^(\.LBB\w+):", text, flags=re.MULTILINE)
    return [
        body[: jump.end()]
        for label, body in zip(blocks[1::2], blocks[2::2], strict=True)
        if (jump := re.search(rf"^\s+j\w+\s+{re.escape(label)}$", body, re.MULTILINE))
    ]


@pytest.fixture(scope="module")
def text_of():
    known: dict[tuple, str] = {}

    def text(*variant: str) -> str:
        if variant not in known:
            known[variant] = assembly(*variant)
        return known[variant]

    return SimpleNamespace(text=text).text


VARIANTS = [
    ("fused", "float32", "fast"),
    ("fused", "float32", "exact"),
    ("fused", "float64", "fast"),
    ("team", "float32", "fast"),
    ("tiled", "float32", "fast"),
]


@pytest.mark.parametrize("variant", VARIANTS, ids="-".join)
def test_loops_along_rows_take_packed_roots_alone(text_of, variant):
    kernel, precision, math = variant
    text = text_of(*variant)
    loops = row_loops(text)
    hot = [loop for loop in loops if len(re.findall(PACKED_ROOT, loop)) >= 2]
    assert hot, "no loop along a row computes both springs of several masses at once"
    for loop in loops:
        assert not re.search(SCALAR_ROOT, loop)
    if kernel != "tiled":
        assert not re.search(SCALAR_ROOT, text), "a remainder loop or a scalar version of a row loop"
    if precision == "float32":
        assert not any(re.search(DOUBLE, loop) for loop in loops)
    if math == "fast" and precision == "float32":
        for loop in hot:
            assert "rsqrt" in loop and not re.search(r"\bvdivp[sd]\b|\bvsqrtps\b", loop), "no reciprocal root"
    if math == "exact":
        assert not re.search(r"rsqrt|\bvfn?m(add|sub)\d+", text), "exact math approximates or contracts"


def test_the_check_sees_what_it_looks_for():
    """Not vacuous: a loop as numba compiles it from plain Python sums fails it."""

    @numba.njit(error_model="numpy")
    def lengths(x, out):
        for j in range(x.size):
            out[j] = 1 / np.sqrt(x[j] * x[j] * 0.5)  # 0.5 and 1 are doubles

    lengths.compile((numba.float32[::1], numba.float32[::1]))
    (compiled,) = lengths.overloads.values()
    text = compiled.library.get_asm_str()
    assert re.search(SCALAR_ROOT, text)
    assert any(re.search(DOUBLE, loop) for loop in row_loops(text))
