"""Bounds on the vibrations of a cloth: on the weighted Laplacian of its springs, or of the dampers along them."""

from __future__ import annotations

import numpy as np

from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import SPRING_KINDS


def cloth_eigenvalue(structural: float, shear: float, bending: float) -> float:
    """Return the largest eigenvalue of the weighted Laplacian of an infinite cloth, in the unit of the stiffnesses.

    A plane wave of phases a, b from column to column and row to row has, with x = cos a and y = cos b, the eigenvalue 2
    s (2 - x - y) + 4 h (1 - x y) + 4 c (2 - x^2 - y^2), a quadratic on a square. Its maximum is at a corner, at an
    edge's vertex, or inside where both derivatives vanish. No cloth exceeds it: each is this one pinned at all other
    masses (which only removes eigenvalues) without some springs (which only lowers them).
    """

    def at(x: float, y: float) -> float:
        return 2 * structural * (2 - x - y) + 4 * shear * (1 - x * y) + 4 * bending * (2 - x * x - y * y)

    places = [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]  # symmetric in x and y
    if bending > 0:
        places += [(x, float(np.clip(-(structural + 2 * shear * x) / (4 * bending), -1, 1))) for x in (1.0, -1.0)]
    if shear + bending > 0:
        inside = max(-1.0, -structural / (2 * shear + 4 * bending))
        places.append((inside, inside))
    return max(at(*place) for place in places)


def most_springs(rows: int, columns: int) -> dict[str, int]:
    """Return the largest number of springs of each kind on one mass of a cloth."""
    near, far = (lambda n: min(n - 1, 2)), (lambda n: (n > 2) + (n > 4))
    return {
        "structural": near(rows) + near(columns),
        "shear": near(rows) * near(columns),
        "bending": far(rows) + far(columns),
    }


def laplacian_bound(scene: Scene, field: str) -> float:
    """Return a bound on the eigenvalues of a cloth's Laplacian, weighted by a `field` of its springs (`stiffness`,
    `damping`).

    It is the smaller of twice the sum over the springs of one mass (Gershgorin), which is smaller on narrow sheets, and
    the value of the infinite cloth, which is smaller on all others.
    """
    weights = {kind: getattr(part, field) for kind, part in scene.cloth_springs.items()}
    most = most_springs(scene.grid.rows, scene.grid.columns)
    gershgorin = 2 * sum(most[kind] * weight for kind, weight in weights.items())
    return min(gershgorin, cloth_eigenvalue(*(weights.get(kind, 0.0) for kind in SPRING_KINDS)))
