"""Second order from two solves of implicit Euler: the diagonally implicit Runge-Kutta method of two stages.

R. Alexander, "Diagonally implicit Runge-Kutta methods for stiff O.D.E.'s", SIAM J. Numer. Anal. 14 (1977), table 1, s =
2: with g = STAGE = 1 - 1 / sqrt(2) the stages of a step h are U_1 = u + g h f(U_1), U_2 = u + (1 - g) h f(U_1) + g h
f(U_2), and the step ends at U_2. It is of order 2 and L-stable: stiff components vanish after a step, as with implicit
Euler, but an oscillation w loses a fraction of order (w h)^4 of its amplitude per step, not (w h)^2 / 2.

With f(U_1) = (U_1 - u) / (g h) the second stage is a step of implicit Euler of g h, too, from u + (1 - g) / g (U_1 -
u). In positions and velocities, since (1 - g) / g = 1 + sqrt(2) and X_1 = x + g h V_1, it starts from X_1 + sqrt(2) g h
V_1 and V_1 + sqrt(2) (V_1 - v). Each stage therefore solves the same problem as order 1, for a substep g h, with the
same matrix where the material is linear.
"""

from __future__ import annotations

from math import sqrt

from softlab.model.base.variant import formula

STAGE = 1 - 1 / sqrt(2)  # of the substep, which each of two stages takes
OPERATIONS_AHEAD = 3 * (3 + 3)

SCALE = sqrt(2)


@formula
def ahead(x, v, start, h):
    return x + (SCALE * h) * v, v + SCALE * (v - start)
