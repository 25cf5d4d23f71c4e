"""A substep of a fluid by the scheme `divergence-free`, and the order of every sum in it, which both backends follow.

model/fluid/plan.py describes arrays, sorting, lists, walls and the stages that it shares; formulas are those of
model/formulas/fluid (divergence.py, density.py, motion.py). Gradients are taken at the positions at the substep's
start, for which the lists are made. The state between substeps is only position and velocity: iterations start at 0 in
each. (With a fixed number of iterations, starting at the full multipliers of the previous substep gains energy: a
column never comes to rest.)

1. `gather`. On an axis that repeats x = x + wrapped_offset(x, low, high, side).
2. `sort into cells`, by x; x, v, number and fluid are sorted together. 3. `find neighbours` of x, and factors, as in
   plan.py, 3, 4.
4. `density and divergence`. t = 0, a = 0; for each neighbour t = density_added(t, closeness(squared)), then dy =
   apart(...), squared again, s = slope, a = approach_added(a, s, d, v_i - v_j). (wall density, its gradient w) at x, at
   the substep's end; C = constraint(t, ...); a = approach_of_wall(a, w, v). came = that wall density minus the one at
   the substep's start, where walls move, else 0. Target of the first solve: compressed(C, a, dt, came).
5. iteration, `iterations` times, of the first solve, with Y and the previous iterate of 0:
   `relax`. c = target; except in the first iteration a = 0, for each neighbour dy, squared, s as in 4, a =
   approach_added(a, s, d, e_i - e_j) of shifts e, then approach_of_wall, and c = c + a; next = pressed(Y, factor, c);
   onward = led(next, iterate, lead(turn, iterations)); delta = onward - Y; Y = onward, iterate = next.
   `push apart`. m = 0; for each neighbour dy, squared, s; m = correction_added(m, delta_i + delta_j, s, d); then
   wall_added(m, delta_i, w) axis by axis. e = moved(e, F_WEIGHT, m), e = 0 before the first.
6. `take up`. u = gained(v, e, inverse_dt); with a maximum acceleration limited_change(u, v, speed_of(u - v), F_CHANGE),
   which is half of the change that it allows per substep; v = u.
7. `normals and vorticity` and the smoothing of velocities, as in plan.py, 7 and 8, where needed; 8. `accelerate`: with
   drag braked(v, ..., C); then gravity and own forces, accelerated and `slowed`, as in plan.py, 1.
9. `foresee density`. a of u as in 4 (of v); came is already in C. Target of the second solve: foreseen(C, a, dt).
10. iteration: `relax` and `push apart` of the second solve, whose Y and shifts start at 0 again.
11. `move`. As 6; then `slowed` to F_SPEED, x = drifted(x, v, dt); without the rebound from walls, as in plan.py, 6,
   from the old x, of v before this solve and its multiplier; and colliders, from the old x to x with v, which is
   `slowed` again. The new state is x and v; pressures are computed from the sum of both solves' Y.
"""

from __future__ import annotations

from softlab.model.fluid.passes import (
    ACCELERATE,
    FIND,
    FORESEE,
    GATHER,
    MOVE,
    PUSH_APART,
    RELAX,
    SHAPE,
    SHAPES,
    SMOOTHING,
    SORT,
    SURVEY,
    TAKE_UP,
    Iterations,
    Pass,
    Scalars,
    around,
)
from softlab.model.formulas.fluid import density, divergence, motion

FIRST, SECOND = 0.0, 1.0  # arguments of the solves' stages
FORCED = {"particle": motion.OPERATIONS_VELOCITY, "force": 1}
SEARCHED = {"candidate": density.OPERATIONS_FIND, "neighbour": density.OPERATIONS_FACTORS}
SEARCH = Pass(FIND, Scalars(1, 1), Scalars(1, 0, 1), SEARCHED)
SOLVE = (
    Pass(RELAX, around(2), Scalars(1), {"neighbour": divergence.OPERATIONS_APPROACH}),
    Pass(PUSH_APART, around(1), Scalars(1), {"neighbour": density.OPERATIONS_CORRECT}),
)
DIVERGENCE_FREE = (
    Pass(GATHER, Scalars(2), Scalars(1), {"axis": 2}),
    Pass(SORT, Scalars(4), Scalars(4), {"axis": 4}),
    SEARCH,
    Pass(SURVEY, around(2), Scalars(1), {"neighbour": density.OPERATIONS_DENSITY + divergence.OPERATIONS_APPROACH}),
    Iterations(SOLVE, FIRST),
    Pass(TAKE_UP, Scalars(2), Scalars(1), {"particle": divergence.OPERATIONS_MOVE}),
    Pass(SHAPE, around(2, particle=2), Scalars(2), {"neighbour": motion.OPERATIONS_SHAPE}, needs=SHAPES),
    Pass(ACCELERATE, Scalars(1), Scalars(1), FORCED, without=SMOOTHING),
    Pass(
        ACCELERATE, around(2, particle=2), Scalars(1), FORCED | {"neighbour": motion.OPERATIONS_SMOOTH}, needs=SMOOTHING
    ),
    Pass(FORESEE, around(2), Scalars(1), {"neighbour": divergence.OPERATIONS_APPROACH}),
    Iterations(SOLVE, SECOND),
    Pass(MOVE, Scalars(3), Scalars(2), {"particle": divergence.OPERATIONS_MOVE, "collider": 1}),
)
