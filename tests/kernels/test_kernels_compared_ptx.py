"""What a variant of a CUDA kernel holds more than another one, from their PTX: no trace of an absent feature."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import Letters, kernel_text
from ptx_rows import VISITS, Row, some

from softlab.model.formulas.constraints import tetrahedron
from softlab.model.position_based.plan import colour_order
from softlab.model.tetrahedra.constraints import DAMPED, ITERATED, part_of_run, projections_of

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def text(factory: str, letters: Letters, arguments: tuple[Any, ...], kernel: str = "") -> str:
    row = Row(factory, {kernel: letters}, arguments)
    return kernel_text(row.kernels(np.float32, "fast")[kernel], letters, np.float32, "fast")


@pytest.mark.parametrize("run", [5, pytest.param(6, marks=pytest.mark.rest)])
def test_tetrahedra_of_a_voxel_are_a_loop(run: int) -> None:
    """Not the code of each tetrahedron."""
    parts = some("fixed-corotated", DAMPED, ITERATED)
    both = [
        text("core.constraints:make_projections", "RRIRRiiiiT", projections_of(parts | more))
        for more in (some(), some(part_of_run("fixed-corotated", run)))
    ]
    assert both[0].count("sqrt") == both[1].count("sqrt") > 0


def test_who_has_no_damper_reads_no_strains() -> None:
    """Six strains beside the values of a tetrahedron, its damper's time, and 1 / h; neither needs a rotation."""
    factory, letters = "tetrahedra.descent_kernels:make_visits", VISITS["descend"]
    plain, damped = (text(factory, letters, (tetrahedron.HOOKEAN, damps, some()), "descend") for damps in (False, True))
    assert damped.count("ld.global.f32") - plain.count("ld.global.f32") == 6 + 2
    assert "sqrt" not in plain and "sqrt" not in damped


def test_a_grid_is_projected_in_two_dimensions() -> None:
    """The third axis leaves no arithmetic: a difference, a square, its product with the scale, two ends."""
    parts = some("structural", "structural-compliance", "alternating", "gravity", "pins", "external", "gauss-seidel")
    first, *_ = colour_order(parts)
    texts = [
        text("position_based.kernels:make_colour", "RRRliPii", (some("structural", "gauss-seidel"), *first, axes))
        for axes in (2, 3)
    ]
    flat, solid = (sum(one.count(f"{word}.ftz.f32") for word in ("add", "sub", "mul", "fma.rn")) for one in texts)
    assert solid - flat >= 4
