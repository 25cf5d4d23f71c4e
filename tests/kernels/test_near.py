"""In exact math the states of the CPU are those of the NumPy reference, to rounding."""

from __future__ import annotations

import numpy as np
import pytest
from bits_row import CPU
from near_rows import Near, rows

from softlab.model.core.build import build
from softlab.model.core.state import State


@pytest.mark.parametrize(
    "near, precision",
    [
        pytest.param(
            near, precision, id=f"{near.row.name}-{precision}".replace(" ", "-"),
            marks=[pytest.mark.rest] if near.rest else [],
        )
        for near in rows() for precision in near.precisions
    ],
)  # fmt: skip
def test_states_are_the_references(near: Near, precision: str) -> None:
    row, scene, body = near.row, near.row.scene(), build(near.row.scene())
    begin = row.start(scene) if row.start else State(body.position, body.velocity, body.inverse_mass, 0.0, 0)
    position, velocity = near.expected(scene, begin)
    state, _ = row.ended(CPU, precision=precision, kernel=row.kernels_of(CPU)[0], threads=1)
    wider = 2.0**29 if precision == "float32" else 1.0
    assert np.abs(state.position - position).max() < near.position * wider
    assert np.abs(state.velocity - velocity).max() < near.velocity * wider
    assert np.abs(position - begin.position).max() > 1e-4, "nothing happened"
