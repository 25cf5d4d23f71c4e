"""In exact math the CUDA kernels, in plain Python, give the CPU's bits."""

from __future__ import annotations

import pytest
from bits_rows import SIMULATOR, Row, cases, different


@pytest.mark.parametrize("row, precision", cases(SIMULATOR))
def test_kernels_have_the_bits_of_the_cpu(row: Row, precision: str) -> None:
    wanted, done = row.ended(SIMULATOR, precision=precision, threads=1)
    for kernel in row.kernels_of(SIMULATOR):
        state, found = row.ended(SIMULATOR, "gpu", precision=precision, kernel=kernel)
        assert not different(state, wanted) and found == done, kernel
    if row.without:
        other, _ = row.ended(SIMULATOR, precision=precision, threads=1, scene=row.without())
        assert "position" in different(other, wanted), "the row does not show what it is for"
