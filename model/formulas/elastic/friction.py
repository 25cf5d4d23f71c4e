"""Friction with colliders within a visit of vertex block descent: a force against the sliding of a vertex in a substep.

A. H. Chen et al., "Vertex Block Descent", ACM TOG 43 (2024), section 3.5, after M. Li et al., "Incremental Potential
Contact", ACM TOG 39 (2020), section 5: mu lambda / max(|u|, e) times u, the displacement tangential to and relative to
the collider, lambda the contact force, e the displacement in a substep at the speed SLIP; and the same factor times I -
nn' for the block. Colliders only respond to velocities (formulas/colliders.py), so that each is called twice with trial
velocities. A fast normal impact sticks and returns the collider's velocity. A slide much faster than its normal
approach loses mu of that, the dynamic coefficient.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from softlab.model.base.variant import OfPrecision, formula

SLIP = 0.01  # m/s: below it friction is a dashpot; a body that it supports on a slope creeps more slowly than that
FAST = 1e4  # m/s: trial speed that finds the collider's velocity
SMALLEST = 1e3  # times the root of the smallest normal number: squares of shorter displacements have no direction
ASIDE = 16.0  # trial sliding speed over approach speed that finds mu: more than any coefficient
OPERATIONS = 110  # without those of the colliders

LEAST = OfPrecision(lambda real: SMALLEST * np.sqrt(np.finfo(real).tiny))


@formula
def unit(x, y, z):
    """Return (length, n) of a vector."""
    length = sqrt((x * x + y * y) + z * z)
    s = 1.0 / length if length > 0.0 else 0.0
    return length, s * x, s * y, s * z


@formula
def straight(n):
    """Trial velocity along the normal."""
    return FAST * n[1], FAST * n[2], FAST * n[3]


@formula
def slid(p, b, c, h, n):
    """Return (length, u) of the displacement from b to p relative to a collider of velocity c, tangential to it."""
    x, y, z = (p[0] - b[0]) - h * c[0], (p[1] - b[1]) - h * c[1], (p[2] - b[2]) - h * c[2]
    along = (x * n[1] + y * n[2]) + z * n[3]
    x, y, z = x - along * n[1], y - along * n[2], z - along * n[3]
    return sqrt((x * x + y * y) + z * z), x, y, z


@formula
def heading(n, u):
    """Unit direction of u. Where u is zero, or only rounding along the normal, any direction tangential to the
    collider: its friction is isotropic."""
    if u[0] > LEAST:
        s = 1.0 / u[0]
        x, y, z = s * u[1], s * u[2], s * u[3]
        along = (x * n[1] + y * n[2]) + z * n[3]
        x, y, z = x - along * n[1], y - along * n[2], z - along * n[3]
        squared = (x * x + y * y) + z * z
        if squared >= 0.5:
            s = 1.0 / sqrt(squared)
            return s * x, s * y, s * z
    if abs(n[1]) <= 0.5:  # perpendicular to n and x, or else to n and y, at least 30 degrees from n
        s = 1.0 / sqrt(n[2] * n[2] + n[3] * n[3])
        return 0.0, s * n[3], -(s * n[2])
    s = 1.0 / sqrt(n[1] * n[1] + n[3] * n[3])
    return -(s * n[3]), 0.0, s * n[1]


@formula
def sliding(c, n, t):
    """Trial velocity that approaches at 1 m/s and slides much faster, along t."""
    return c[0] + (n[1] + ASIDE * t[0]), c[1] + (n[2] + ASIDE * t[1]), c[2] + (n[3] + ASIDE * t[2])


@formula
def rubbed(v, w, n, u, t, hard, h):
    """Return (derivative, three numbers; block, six) where the trial velocity v became w. Both are continuous where
    nothing slides: there the derivative is 0, and the block its limit, mu lambda / e (I - nn')."""
    lost = max(((v[0] - w[0]) * t[0] + (v[1] - w[1]) * t[1]) + (v[2] - w[2]) * t[2], 0.0)
    s = (hard * n[0]) * lost / max(u[0], SLIP * h)
    return (
        s * u[1], s * u[2], s * u[3], s * (1.0 - n[1] * n[1]), s * (1.0 - n[2] * n[2]), s * (1.0 - n[3] * n[3]),
        -(s * (n[1] * n[2])), -(s * (n[1] * n[3])), -(s * (n[2] * n[3])),
    )  # fmt: skip
