"""The grid's CUDA kernels compiled without a GPU: what the table of tests/kernels/ptx_rows.py cannot say by counts."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from kernel_text import kernel_text
from ptx_rows import GRID, PASS, tile_row

from softlab.model.core.parameters import PARAMETERS

pytestmark = pytest.mark.usefixtures("ptx_compiler")


@pytest.mark.parametrize("name,tile", [("one-block", "32x32x1h0"), ("tiles", "64x8x8h4"), ("resident", "64x8x8h4")])
def test_tiles_read_constants_once(name: str, tile: str) -> None:
    """Behind the first barrier nothing but pairs is read from global memory."""
    row = tile_row(name, "lab", tile, GRID - {"external"}, True)
    text = kernel_text(row.kernels(np.float32, "fast")[""], row.letters[""], np.float32, "fast")
    assert "ld.global.f32" not in text.split("bar.sync", 1)[1]


@pytest.mark.parametrize("real,word,size", [(np.float32, "f32", 4), (np.float64, "f64", 8)])
def test_alternating_springs_read_two_constants_more_and_equal_ones_do_not(real: Any, word: str, size: int) -> None:
    """Parity picks the place in the record that a spring's two constants are read from: four springs, no branch, still six
    loads of a pair; float32 stays float32, exact math stays uncontracted."""
    from softlab.gpu_backend.mass_spring.grid.kernels import make_passes

    stiff, stiffness, stiff_rest, stiffness_rest = (
        PARAMETERS.index(name) * size for name in ("stiff", "stiffness", "stiff_rest", "stiffness_rest")
    )
    places = {frozenset({stiff, stiffness}), frozenset({stiff_rest, stiffness_rest})}
    last = f"+{stiff}]", f"+{stiff_rest}]"
    for math in ("fast", "exact"):
        equal, uneven = (
            kernel_text(make_passes(real, math, "lab", GRID | more)["step"], PASS, real, math)
            for more in (frozenset(), {"alternating"})
        )
        address = {name: int(offset) for name, offset in re.findall(r"add\.s64\s+(%rd\d+), %rd\d+, (\d+);", uneven)}
        choices = re.findall(r"selp\.b64\s+\S+ (%rd\d+), (%rd\d+),", uneven)
        picked = [frozenset(address.get(name, 0) for name in pair) for pair in choices]
        assert places <= set(picked)  # how often depends on what the compiler reuses
        assert not re.search(r"selp\.b64\s+\S+ %rd\d+, %rd\d+,", equal) and not any(place in equal for place in last)
        assert uneven.count(f"ld.global.v2.{word}") == equal.count(f"ld.global.v2.{word}") == 6
        assert "ld.local" not in uneven and (word == "f64" or ".f64" not in uneven)
        assert math == "fast" or ("fma." not in uneven and "approx" not in uneven)


@pytest.mark.parametrize("real,word", [(np.float32, "f32"), (np.float64, "f64")])
def test_the_arithmetic_rate_is_one_of_fused_multiply_adds(real: Any, word: str) -> None:
    """Nothing but fused products and sums in the loop, in registers, and in float32 no double."""
    from softlab.gpu_backend.core.arithmetic import NUMBERS, UNROLLED, make_chains

    text = kernel_text(make_chains(real), "Rirr", real, "fast")
    assert text.count("fma.rn") >= NUMBERS * UNROLLED
    assert "ld.local" not in text and "st.local" not in text
    assert word == "f64" or ".f64" not in text
