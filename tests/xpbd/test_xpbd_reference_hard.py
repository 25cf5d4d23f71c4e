"""The NumPy reference of XPBD where it is hard: ratios of masses and stiffness, long ropes, implicit Euler as the limit."""

import numpy as np
import pytest
from test_xpbd_reference import DOWN, FRAME, chain, inverse
from xpbd_scenes import HEAVY_END

from softlab.bench.reference import xpbd


def implicit_euler(constraints, p, v, w, h, acceleration):
    """One step of M (x - x~) = h^2 F(x), by Newton with the whole derivative, in dense matrices."""
    a, b, k = constraints.first, constraints.second, 1 / constraints.compliance
    free = np.flatnonzero(w > 0)
    dimensions = p.shape[1]
    predicted = np.where((w > 0)[:, None], p + h * (v + h * acceleration), p)
    x = predicted.copy()
    for _ in range(20):
        gradient = np.zeros_like(x)
        gradient[free] = (x - predicted)[free] / w[free, None] / h**2
        hessian = np.zeros((len(p), dimensions, len(p), dimensions))
        for q in free:
            hessian[q, :, q, :] += np.eye(dimensions) / w[q] / h**2
        for i, j, stiffness, rest in zip(a, b, k, constraints.rest_length, strict=True):
            d = x[j] - x[i]
            length = np.linalg.norm(d)
            n = d / length
            gradient[j] += stiffness * (length - rest) * n
            gradient[i] -= stiffness * (length - rest) * n
            outer = np.outer(n, n)
            block = stiffness * (outer + (1 - rest / length) * (np.eye(dimensions) - outer))
            for r, s, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
                hessian[r, :, s, :] += sign * block
        size = len(free) * dimensions
        move = np.linalg.solve(
            hessian[np.ix_(free, range(dimensions), free, range(dimensions))].reshape(size, size),
            gradient[free].ravel(),
        ).reshape(-1, dimensions)
        x[free] -= move
        if np.abs(move).max() < 1e-14:
            break
    return x, (x - p) / h


def test_converges_to_implicit_euler_but_for_the_turning():
    """A chain swinging from the horizontal for 18 frames: converged XPBD against Newton's implicit Euler."""
    constraints, w = chain(10, 1.0, 0.1), inverse(np.full(11, 0.01))
    start = np.stack([np.arange(11.0), np.zeros(11)], axis=-1)
    apart = []
    for substeps in (1, 4):
        h = FRAME / substeps
        p, v = start, np.zeros_like(start)
        x, u = start, np.zeros_like(start)
        for _ in range(18 * substeps):
            state = xpbd.substep(constraints, p, v, DOWN, w, h, 40)
            p, v = state.position, state.velocity
            x, u = implicit_euler(constraints, x, u, w, h, DOWN)
        apart.append(np.abs(p - x).max())
    assert 0 < apart[0] < 1e-3
    assert apart[1] < apart[0] / 4


@pytest.mark.parametrize(
    ("substeps", "iterations", "ordering", "percent"), [*HEAVY_END, (100, 1, "weighted-jacobi", 4.15)]
)
def test_mass_ratio_1000(substeps, iterations, ordering, percent):
    """B2: 20 links of 0.05 m, 1 g a mass and 1 kg at the end, inextensible: largest stretch in the frames 20 to 40."""
    masses = np.full(21, 0.001)
    masses[-1] = 1.0
    constraints, w = chain(20, 0.05, 0.0), inverse(masses)
    p = np.stack([np.zeros(21), -0.05 * np.arange(21)], axis=-1)
    v, stretches = np.zeros_like(p), []
    for _ in range(40):
        for _ in range(substeps):
            state = xpbd.substep(constraints, p, v, DOWN, w, FRAME / substeps, iterations, ordering)
            p, v = state.position, state.velocity
        stretches.append(100 * (-p[-1, 1] - 1))
    assert max(stretches[19:]) == pytest.approx(percent, rel=6e-3)  # three digits, two for 1.01
