"""A substep of a fluid by the scheme `divergence-free`, and the order of every sum in it, which both backends keep.

Arrays, sorting, lists and walls are those of model/fluid/plan.py, whose stages are told there; formulas are
model/formulas/fluid's (divergence.py, density.py, motion.py). Gradients are taken where particles are as the substep
begins, of which the lists are made. The state between substeps is position and velocity, no more: iterations start at 0 in
each. (With a fixed number of them, the multipliers of the substep before, whole, gain energy: a column never comes to rest.)

1. `gather`. Of an axis that repeats x = x + turned_round(x, low, high, side).
2. `sort into cells`, by x; with each go x, v, number and fluid. 3. `find neighbours` of x, and factors, as in plan.py, 3, 4.
4. `density and divergence`. t = 0, a = 0; for each neighbour t = density_added(t, closeness(squared)), then dy = apart(...),
   squared anew, s = slope, a = approach_added(a, s, d, v_i - v_j). (wall density, its gradient w) at x, at the substep's
   end; C = constraint(t, ...); a = approach_of_wall(a, w, v). came = that wall density less the one at the substep's begin,
   where walls move, else 0. The first solve's target: compressed(C, a, dt, came).
5. iteration, as many as told, of the first solve, with Y and the iterate before of 0:
   `relax`. c = target; but for the first iteration a = 0, for each neighbour dy, squared, s as in 4, a = approach_added(a,
   s, d, e_i - e_j) of shifts e, then approach_of_wall, and c = c + a; next = pressed(Y, factor, c); onward = led(next,
   iterate, lead(turn, iterations)); delta = onward - Y; Y = onward, iterate = next.
   `push apart`. m = 0; for each neighbour dy, squared, s; m = correction_added(m, delta_i + delta_j, s, d); then
   wall_added(m, delta_i, w) axis by axis. e = moved(e, F_WEIGHT, m), e = 0 before the first.
6. `take up`. u = gained(v, e, inverse_dt); with a maximum acceleration held_back(u, v, speed_of(u - v), F_CHANGE), which is
   half of what that allows a substep; v = u.
7. `normals and vorticity` and what neighbours do to velocities, as in plan.py, 7 and 8, where one is asked for; 8.
   `accelerate`: with drag braked(v, ..., C); then gravity and own forces, accelerated and `slowed`, as in plan.py, 1.
9. `foresee density`. a of u as in 4 (of v), came is in C already. The second solve's target: foreseen(C, a, dt).
10. iteration: `relax` and `push apart` of the second solve, whose Y and shifts begin at 0 anew.
11. `move`. As 6; then `slowed` to F_SPEED, x = drifted(x, v, dt); without the rebound from walls, as in plan.py, 6, from x
   before, of v before this solve and its multiplier; and colliders, from x before to x with v, which is `slowed` again.
   The new state is x and v; the multiplier of which pressures are read is the first solve's Y plus the second's.
"""

from __future__ import annotations

from model.core.plan import Node, Stage
from model.formulas.fluid import density, divergence, motion

FIRST, SECOND = 0.0, 1.0  # solves: arguments of their stages


def divergence_stages(
    smooths: bool, shapes: bool, operations: dict[str, int], met: float, axes: int, iterations: int
) -> tuple[Stage | Node, ...]:
    """The stages of a substep. `operations` of a particle: `find`, `forces`, `touch`; `met`: neighbours; numbers that are
    moved are per particle and axis, those of neighbours as many as at rest."""
    listed, gathered = round(met / axes), round(met)

    def around(vectors: int) -> int:
        """What a sum over neighbours reads, of so many vectors of each."""
        return 1 + vectors * gathered + listed

    def solve(which: float) -> Node:
        approach = round(met * divergence.OPERATIONS_APPROACH)
        push = round(met * density.OPERATIONS_CORRECT)
        pair = Stage("relax", around(2), 1, approach, which), Stage("push apart", around(1), 1, push, which)
        return Node("iteration", pair, iterations)

    both = round(met * (density.OPERATIONS_DENSITY + divergence.OPERATIONS_APPROACH))
    stages: list[Stage | Node] = [
        Stage("gather", 2, 1, 2 * axes),
        Stage("sort into cells", 4, 4, 4 * axes),
        Stage("find neighbours", 1 + gathered, 1 + listed, operations["find"]),
        Stage("density and divergence", around(2), 1, both),
        solve(FIRST),
        Stage("take up", 2, 1, divergence.OPERATIONS_MOVE),
    ]
    if shapes:
        stages.append(Stage("normals and vorticity", 1 + around(2), 2, round(met * motion.OPERATIONS_SHAPE)))
    own = motion.OPERATIONS_VELOCITY + operations["forces"]
    last = Stage("accelerate", 1, 1, own)
    if smooths:
        last = Stage("accelerate", 1 + around(2), 1, own + round(met * motion.OPERATIONS_SMOOTH))
    foresee = Stage("foresee density", around(2), 1, round(met * divergence.OPERATIONS_APPROACH))
    return (
        *stages,
        last,
        foresee,
        solve(SECOND),
        Stage("move", 3, 2, divergence.OPERATIONS_MOVE + operations["touch"]),
    )
