"""The stages of the mass-spring plan, one kernel each, run over the whole grid: the teaching version.

One mass at a time sums the pulls of its up to four neighbours; every row is an iteration of a parallel loop. Each stage
has separate input and output arrays, which makes it slow, but easy to read, to time and to test against.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.own_forces import bind_forces
from softlab.cpu_backend.core.simulation import RowsSimulation
from softlab.cpu_backend.mass_spring.motion_stages import Planes, bind_motion, make_motion_stages
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, routine
from softlab.model.core.plan import Moment, StageRun
from softlab.model.formulas.springs import spring_acceleration_2d


@routine
def pull(x, y, i, j, row, column, lower, parameters):
    """Return the pull on mass (i, j) from (row, column), by a spring from row or column `lower` to the next."""
    odd = lower & 1
    stiffness = parameters.stiff if odd else parameters.stiffness
    rest = parameters.stiff_rest if odd else parameters.stiffness_rest
    return spring_acceleration_2d(x[row, column] - x[i, j], y[row, column] - y[i, j], stiffness, rest)


@routine
def spring_forces(x, y, record, ax, ay):
    rows, columns = x.shape
    stiffness, stiffness_rest = record[0].stiffness, record[0].stiffness_rest
    for row in prange(rows):
        i = np.int64(row)
        for j in range(columns):
            # a neighbour beyond the edge is replaced by the mass itself: coincident masses do not pull
            up, down, left, right = max(i - 1, 0), min(i + 1, rows - 1), max(j - 1, 0), min(j + 1, columns - 1)
            if FEATURE.alternating:
                right_x, right_y = pull(x, y, i, j, i, right, j, record[0])
                left_x, left_y = pull(x, y, i, j, i, left, left, record[0])
                down_x, down_y = pull(x, y, i, j, down, j, i, record[0])
                up_x, up_y = pull(x, y, i, j, up, j, up, record[0])
            else:
                right_x, right_y = spring_acceleration_2d(
                    x[i, right] - x[i, j], y[i, right] - y[i, j], stiffness, stiffness_rest
                )
                left_x, left_y = spring_acceleration_2d(
                    x[i, left] - x[i, j], y[i, left] - y[i, j], stiffness, stiffness_rest
                )
                down_x, down_y = spring_acceleration_2d(
                    x[down, j] - x[i, j], y[down, j] - y[i, j], stiffness, stiffness_rest
                )
                up_x, up_y = spring_acceleration_2d(x[up, j] - x[i, j], y[up, j] - y[i, j], stiffness, stiffness_rest)
            ax[i, j] = (right_x + left_x) + (down_x + up_x)
            ay[i, j] = (right_y + left_y) + (down_y + up_y)


@cache
def make_stages(real: Real, math: str, integrator: str, alternating: bool = False) -> SimpleNamespace:
    """Compile the stage kernels of an arithmetic and integrator, for equal or alternating springs. Arrays are (rows,
    columns)."""
    compiler = Compiler("_".join(["stage", np.dtype(real).name, math, integrator.replace("-", "_")]), math)
    stages = make_motion_stages(compiler, real, integrator)
    variant = compiler.variant_of(real, {"alternating": alternating})
    stages.spring_forces = compiler.kernel(variant.copied(spring_forces))
    return stages


def bind_stages(sim: RowsSimulation) -> dict[str, StageRun]:
    """Return the function of each named stage of `sim`, a cpu_backend.mass_spring.grid.solver.MassSpring."""
    alternating = "alternating" in sim.plan.parts
    make = make_stages(sim.real, sim.options.math, sim.scene.method.integrator, alternating)
    acceleration = np.zeros((2, sim.body.rows, sim.body.columns), sim.real)
    at: dict[str, Planes] = {"state": sim.current}  # state at which forces are evaluated: the state, or a stage of RK4
    pin_rows, pin_columns = np.divmod(sim.body.pinned, sim.body.columns)

    def spring_forces(moment: Moment) -> None:
        make.spring_forces(at["state"][0], at["state"][1], sim.record, acceleration[0], acceleration[1])

    def no_forces(moment: Moment) -> None:
        acceleration[:] = 0

    def pins(moment: Moment) -> None:
        for axis in range(2):
            at["state"][axis][pin_rows, pin_columns] = sim.pinned_position[axis]
            at["state"][2 + axis][pin_rows, pin_columns] = 0

    bound = bind_forces(sim, acceleration) | bind_motion(sim, make, at, sim.current, acceleration, lambda: None)
    return bound | {
        "spring forces": spring_forces,
        "no forces": no_forces,
        "pins": pins,
    }
