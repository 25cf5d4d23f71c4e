"""What iterations lead to."""

from __future__ import annotations

import numpy as np
from lab import Lab, farthest, masses, stirred
from law import limit_of, of
from rows import Row
from test_law_energy import slope

FEW, MANY = 1, 64


@of("limit")
def test_iterations_lead_to_the_implicit_solution(row: Row, case: str, lab: Lab) -> None:
    """A step of implicit Euler makes g(x) = M (x - y)/h^2 + grad E(x) zero, y = x0 + h v0. After one iteration it is
    what is left of the first residual, grad E(y); after many it is less, and less than a tenth of the first: the
    lines along which positions were moved were taken at iterates, which turn by the strain of a step (5 %) until they
    stand still (Macklin and others 2016, section 4). Newton's method and descents, which follow E itself, leave no
    such part: a thousandth, as does a step of order 2 against its own stage. Where the force is no gradient, one iteration
    may by chance be nearer than many."""
    method = row.tables["method"]
    if "iterations" not in method:  # implicit Euler of a cloth, solved to the end, or linearised
        residuals = [residual(row, lab, None)]
    else:
        residuals = [residual(row, lab, count) for count in (FEW, MANY)]
    first = residual(row, lab, 0)
    exact = row.solver in ("newton", "vbd") or row.name == "cloth, implicit-euler"
    limit = limit_of("limit", row)
    assert residuals[-1] <= (limit.part if limit else 1e-3 if exact else 0.1) * first, (first, residuals)
    blur = 1e-6 * first  # of central differences, see `slope`: a cluster that turns as one is at its goal at once
    assert limit or residuals[-1] <= residuals[0] + blur, (first, residuals)


def residual(row: Row, lab: Lab, iterations: int | None) -> float:
    """[N]: the largest |g| after a substep of so many iterations; 0: of where inertia alone leads."""
    more = {"substeps": 1, "dt": row.h} if "substeps" in row.tables["method"] else {}
    scene = row.scene(method=more | ({"iterations": iterations} if iterations else {}))
    begin = stirred(row, scene)
    h = scene.method.dt
    ahead = begin.position + h * begin.velocity
    place = np.asarray(lab.run(scene, 1, begin).position, np.float64) if iterations != 0 else ahead
    return farthest(masses(begin) * (place - ahead) / h**2 - slope(scene, place))
