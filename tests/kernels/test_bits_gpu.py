"""In exact math a GPU gives the CPU's bits, by every kernel, and goes on from a state of the CPU."""

from __future__ import annotations

import pytest
from bits_row import GPU, Row, cases, different
from bits_rows import ROWS

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("row, precision", cases(ROWS, GPU))
def test_every_kernel_has_the_bits_of_the_cpu(row: Row, precision: str) -> None:
    turn, kernels = row.turn(GPU), row.kernels_of(GPU)
    rest = (row.steps[GPU] - turn,)
    half, _ = row.ended(GPU, precision=precision, threads=2, parts=(turn,))
    wanted, done = row.ended(GPU, precision=precision, threads=2, parts=rest, initial=half)
    for kernel in kernels:
        state, _ = row.ended(GPU, "gpu", precision=precision, kernel=kernel)
        assert not different(state, wanted), kernel
    state, found = row.ended(GPU, "gpu", precision=precision, kernel=kernels[0], parts=rest, initial=half)
    assert not different(state, wanted) and found == done, "from a state of the CPU"
