"""The GPU's arithmetic loop, in plain Python: what it computes, and that the rate can be asked for."""

from __future__ import annotations

import numpy as np
import pytest
from numba import cuda

from softlab.gpu_backend.core.arithmetic import NUMBERS, UNROLLED, arithmetic_rate, make_chains


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_every_number_of_a_thread_goes_through_every_round(real: type) -> None:
    """x -> x f + s, n times, is x f^n + s (1 - f^n) / (1 - f), summed over the numbers that a thread starts from."""
    factor, summand, rounds = 0.5, 0.25, 3
    out = cuda.to_device(np.zeros(2, real))
    make_chains(real)[1, 2](out, np.int32(rounds), real(factor), real(summand))
    n = rounds * UNROLLED
    for k, found in enumerate(out.copy_to_host()):
        a = factor * k
        starts = [a, a + summand, a - summand, a * factor]
        starts += [starts[1] * factor, starts[2] * factor, starts[3] * factor, starts[1] + summand]
        assert len(starts) == NUMBERS
        expected = sum(x * factor**n + summand * (1 - factor**n) / (1 - factor) for x in starts)
        assert found == pytest.approx(expected, rel=1e-5)


def test_a_rate_can_be_asked_for() -> None:
    assert arithmetic_rate("float32", budget=0.0) > 0
