"""Springs of a row with every second one stiffer (the part `alternating`), as mass_spring/grid/rows.py for equal
springs.

The stiffness of a spring follows from its lower end: odd columns along a row, odd rows down a column. Parts of a row
begin at whole blocks of columns, an even number, so a column has the parity of its index in the part.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import block_of
from softlab.model.base.types import Real


def make_alternating_rows(
    compiler: Compiler, real: Real, spring_acceleration_2d: Callable, sum_accelerations: Callable,
    with_gravity: Callable,
) -> SimpleNamespace:  # fmt: skip
    """Make `spring_constants`, `pull_from_below`, `sum_row` from the functions of mass_spring/grid/rows.py."""
    block = block_of(real)

    @compiler.compiled
    def spring_constants(lower, parameters):
        """Return (stiffness, stiffness * rest length), both over mass, of a spring from row or column `lower` to the
        next."""
        if lower & 1:
            return parameters.stiff, parameters.stiff_rest
        return parameters.stiffness, parameters.stiffness_rest

    @compiler.row
    def pull_from_below(i, blocks, x, y, x_below, y_below, parameters, out_x, out_y):
        """Write the accelerations of row `i` by the row below; with the opposite sign those of the row below."""
        stiffness, rest = spring_constants(i, parameters)
        for j in range(blocks * block):
            pull_x, pull_y = spring_acceleration_2d(x_below[j] - x[j], y_below[j] - y[j], stiffness, rest)
            out_x[j] = pull_x
            out_y[j] = pull_y

    @compiler.row
    def sum_row(i, blocks, x, y, x_below, y_below, left_x, left_y, above_x, above_y, parameters, close_x, close_y):
        """Sum springs and gravity of row `i` into `close`; otherwise as rows.sum_row."""
        soft, soft_rest = spring_constants(0, parameters)
        stiff, stiff_rest = spring_constants(1, parameters)
        down, down_rest = spring_constants(i, parameters)
        for j in range(blocks * block):
            odd = j & 1
            across, across_rest = stiff if odd else soft, stiff_rest if odd else soft_rest
            right_x, right_y = spring_acceleration_2d(x[j + 1] - x[j], y[j + 1] - y[j], across, across_rest)
            below_x, below_y = spring_acceleration_2d(x_below[j] - x[j], y_below[j] - y[j], down, down_rest)
            ax = sum_accelerations(right_x, left_x, below_x, above_x[j])
            ay = sum_accelerations(right_y, left_y, below_y, above_y[j])
            left_x, left_y = right_x, right_y
            above_x[j] = below_x
            above_y[j] = below_y
            close_x[j] = ax
            close_y[j] = with_gravity(ay, parameters)

    return SimpleNamespace(spring_constants=spring_constants, pull_from_below=pull_from_below, sum_row=sum_row)
