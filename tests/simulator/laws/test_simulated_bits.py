"""In exact math the CUDA kernels, in plain Python, give the CPU's bits, and go on from a state of the CPU."""

from __future__ import annotations

import pytest
from bits_row import SIMULATOR, Row, cases, different
from bits_rows import ROWS
from test_simulated_tiles import blocks_together  # noqa: F401  # a fixture


@pytest.mark.parametrize("row, precision", cases(ROWS, SIMULATOR))
def test_kernels_have_the_bits_of_the_cpu(row: Row, precision: str, request: pytest.FixtureRequest) -> None:
    if any("resident" in str(kernel) for kernel in row.kernels):
        request.getfixturevalue("blocks_together")
    wanted, done = row.ended(SIMULATOR, precision=precision, threads=1)
    for kernel in row.kernels_of(SIMULATOR):
        state, found = row.ended(SIMULATOR, "gpu", precision=precision, kernel=kernel)
        assert not different(state, wanted) and found == done, kernel
    if turn := row.later and row.turn(SIMULATOR):
        half, _ = row.ended(SIMULATOR, precision=precision, threads=1, parts=(turn,))
        parts = (row.steps[SIMULATOR] - turn,)
        state, _ = row.ended(SIMULATOR, "gpu", precision=precision, kernel=kernel, parts=parts, initial=half)
        assert not different(state, wanted), "from a state of the CPU"
    if row.without:
        other, _ = row.ended(SIMULATOR, precision=precision, threads=1, scene=row.without())
        assert "position" in different(other, wanted), "the row does not show what it is for"
