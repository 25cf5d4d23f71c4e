"""The method of manufactured solutions on the grid: the force that makes a chosen motion exact.

Roache, "Code verification by the method of manufactured solutions", J. Fluids Eng. 124 (2002): choose p*(t), put it
into the equation of motion, and add the remainder as a force. Any error then is the solver's own.
"""

from __future__ import annotations

from math import cos, sin

from softlab.model.formulas import plain
from softlab.model.formulas.springs import make as make_springs

OPERATIONS = 150


def make(real, compiled=plain):
    """Make `manufactured_acceleration(i, j, rows, columns, t, ...) -> (ax, ay)` and `stage_time`, in the arithmetic
    `real`."""
    two, three, four, nine = real(2), real(3), real(4), real(9)
    p_row, p_column, q_row, q_column = real(1.7), real(0.9), real(0.6), real(1.3)
    spring_acceleration_2d, _ = make_springs(real, compiled)

    @compiled
    def displacement(i, j, t, amplitude):
        """p*(t) - rest = amplitude * [sin(2 t + 1.7 i + 0.9 j), cos(3 t + 0.6 i - 1.3 j)] (i = row, j = column)."""
        return (
            amplitude * sin(two * t + p_row * real(i) + p_column * real(j)),
            amplitude * cos(three * t + q_row * real(i) - q_column * real(j)),
        )

    @compiled
    def manufactured_acceleration(
        i, j, rows, columns, t, amplitude, inertia, spacing, stiffness, stiffness_rest, gravity, rate
    ):
        """inertia p*'' - a(p*, p*'): the term to add to the scene's own acceleration a [m/s^2] at time t [s]."""
        x, y = displacement(i, j, t, amplitude)
        ax = -(inertia * four) * x
        ay = -(inertia * nine) * y - gravity
        phase_x = two * t + p_row * real(i) + p_column * real(j)
        phase_y = three * t + q_row * real(i) - q_column * real(j)
        ax += rate * (two * amplitude * cos(phase_x))
        ay -= rate * (three * amplitude * sin(phase_y))
        for side in range(4):
            row = i + (side == 2) - (side == 3)
            column = j + (side == 0) - (side == 1)
            if row >= 0 and row < rows and column >= 0 and column < columns:
                nx, ny = displacement(row, column, t, amplitude)
                dx = spacing * real(column - j) + (nx - x)
                dy = (ny - y) - spacing * real(row - i)
                fx, fy = spring_acceleration_2d(dx, dy, stiffness, stiffness_rest)
                ax -= fx
                ay -= fy
        return ax, ay

    @compiled
    def stage_time(step, offset, dt, first_step, first_time):
        """Time [s] of a stage `offset` steps into step number `step`. Step number `first_step` begins at `first_time`
        [s]."""
        return first_time + ((real(step) - first_step) * dt + offset * dt)

    return manufactured_acceleration, stage_time
