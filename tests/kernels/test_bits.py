"""In exact math a state has the same bits on any number of threads, by both kernels of the CPU, in one call and in several,
and from a state on the way that went through a file."""

from __future__ import annotations

from pathlib import Path

import pytest
from bits_row import CPU, Row, cases, different
from bits_rows import ROWS

from softlab.app.output.files import read_state, write_state


@pytest.mark.parametrize("row, precision", cases(ROWS, CPU))
def test_threads_kernels_and_restarts_give_the_same_bits(row: Row, precision: str, tmp_path: Path) -> None:
    kernels, turn = row.kernels_of(CPU), row.turn(CPU)
    rest = row.steps[CPU] - turn
    wanted, done = row.ended(CPU, precision=precision, kernel=kernels[0], threads=1)
    for kernel, threads in zip(kernels, (2, 3, 4, 2), strict=False):
        state, found = row.ended(CPU, precision=precision, kernel=kernel, threads=threads, parts=(turn, 0, rest))
        assert not different(state, wanted) and found == done, (kernel, threads)
    half, _ = row.ended(CPU, precision=precision, kernel=kernels[-1], threads=1, parts=(turn,))
    stored = read_state(write_state(tmp_path / "half.npz", half), row.scene())
    state, _ = row.ended(CPU, precision=precision, kernel=kernels[-1], threads=1, parts=(rest,), initial=stored)
    assert not different(state, wanted)
    if row.without:
        other, _ = row.ended(CPU, precision=precision, kernel=kernels[0], threads=1, scene=row.without())
        assert "position" in different(other, wanted), "the row does not show what it is for"
