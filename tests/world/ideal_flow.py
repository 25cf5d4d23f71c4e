"""Added mass of a cube in a tank, by potential flow: finite differences on cubic cells, without any part of the lab."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

EDGES = 2 ** (4 / 3)  # by which cells of half the size reduce the error: the flow around a right edge goes as r^(2/3)


def added_mass(across: int, tank: int, below: int, above: int, fine: int) -> float:
    """Added mass of a cube that begins to rise, over the mass of the water that it displaces.

    Lengths in layers: the cube's side, the tank's, and the water under and over the cube; extrapolated from `fine` and twice
    as many cells in a layer.
    """
    coarse, finer = (_added_mass(across * n, tank * n, below * n, above * n) for n in (fine, 2 * fine))
    return finer - (coarse - finer) / (EDGES - 1)


def _added_mass(across: int, tank: int, below: int, above: int) -> float:
    """Added mass by cells; lengths in cells.

    In the water laplace(phi) = 0; at the surface phi = 0 (no pressure), at the walls it has no slope, at the cube the slope 1
    along y. The kinetic energy is half the integral of phi times that over the cube's faces, which are half a cell from the
    cells' middles. Two planes of symmetry leave a quarter of the tank, which begins at the cube's axis.
    """
    half, side, high = across // 2, tank // 2, below + across
    water = np.ones((side, high + above, side), bool)
    water[:half, below:high, :half] = False
    faces = [water.take(range(n - 1), axis) & water.take(range(1, n), axis) for axis, n in enumerate(water.shape)]

    def outflow(values: np.ndarray) -> np.ndarray:
        """Sum of the flows out of each cell; the surface is half a cell above the highest."""
        phi = values.reshape(water.shape)
        total = np.where(water, 0.0, phi)
        total[:, -1] += 2 * phi[:, -1]
        for axis, inside in enumerate(faces):
            pad = [(int(other == axis),) * 2 for other in range(3)]
            total -= np.diff(np.pad(np.diff(phi, axis=axis) * inside, pad), axis=axis)
        return total.ravel()

    pushed = np.zeros(water.shape)
    pushed[:half, below - 1, :half], pushed[:half, high, :half] = 1, -1
    phi, failed = cg(LinearOperator((pushed.size,) * 2, outflow, dtype=float), pushed.ravel(), rtol=1e-6)
    assert not failed
    return float(phi @ pushed.ravel()) / (half * half * across) + 1 / across
