"""In exact math a GPU gives the CPU's bits, by every kernel."""

from __future__ import annotations

import pytest
from bits_rows import GPU, Row, cases, different

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("row, precision", cases(GPU))
def test_every_kernel_has_the_bits_of_the_cpu(row: Row, precision: str) -> None:
    wanted, done = row.ended(GPU, precision=precision, threads=2)
    for kernel in row.kernels_of(GPU):
        state, found = row.ended(GPU, "gpu", precision=precision, kernel=kernel)
        assert not different(state, wanted) and found == done, kernel
