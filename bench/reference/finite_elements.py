"""Bodies of linear tetrahedra by finite elements, NumPy and SciPy, float64: assembly, sparse factorisation, modes.

The reference of every solver of tetrahedra: its result is exact on the same mesh, so that a difference is the solver's
own error and not the mesh's. From the textbooks (Sifakis and Barbic, "FEM Simulation of 3D Deformable Solids", SIGGRAPH
courses 2012; Bathe, "Finite Element Procedures"), without model/formulas or a backend. Newton's method, statics of
large displacements and implicit Euler are in bench/reference/finite_elements_newton.py.

Meshes are plain arrays: positions (n, 3) [m], tetrahedra (m, 4) of vertices, the edges from the first to the others a
right-handed system (volume > 0); Young's modulus [Pa], Poisson's ratio and density [kg/m^3] are numbers or (m,).
`fixed`: mask of fixed vertices (n,) or coordinates (n, 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import eigsh, splu

from softlab.bench.reference import elastic_materials

Values = np.ndarray | float


def shape_gradients(position: np.ndarray, tetrahedra: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rest volumes (m,) [m^3] and the gradients (m, 4, 3) [1/m] of the four corners' hat functions."""
    corners = position[tetrahedra]
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    volume = np.linalg.det(edges) / 6
    if not (volume > 0).all():
        raise ValueError(f"tetrahedron {int(np.argmin(volume))} has no volume, or is inside out")
    others = np.linalg.inv(edges)
    return volume, np.concatenate([-others.sum(axis=1, keepdims=True), others], axis=1)


def lumped_mass(position: np.ndarray, tetrahedra: np.ndarray, density: Values) -> np.ndarray:
    """Return the lumped masses (n,) [kg]: a quarter of each tetrahedron's mass for each of its corners."""
    volume, _ = shape_gradients(position, tetrahedra)
    quarter = np.repeat(density * volume / 4, 4)
    return np.bincount(tetrahedra.ravel(), quarter, minlength=len(position))


@dataclass(frozen=True)
class Body:
    """Mesh at rest with a material of bench/reference/elastic_materials.py; made by `Body.of`."""

    rest: np.ndarray
    tetrahedra: np.ndarray
    material: str
    mu: np.ndarray
    lam: np.ndarray
    volume: np.ndarray
    gradient: np.ndarray

    @classmethod
    def of(cls, position: np.ndarray, tetrahedra: np.ndarray, material: str, young: Values, poisson: Values) -> Body:
        tetrahedra = np.asarray(tetrahedra, dtype=np.int64)
        volume, gradient = shape_gradients(position, tetrahedra)
        mu, lam = (np.broadcast_to(value, volume.shape) for value in elastic_materials.lame(young, poisson))
        return cls(np.array(position, dtype=np.float64), tetrahedra, material, mu, lam, volume, gradient)

    def deformation(self, position: np.ndarray) -> np.ndarray:
        """Return the deformation gradient F of each tetrahedron: (m, 3, 3)."""
        return np.einsum("mai,maj->mij", position[self.tetrahedra], self.gradient)

    def energy(self, position: np.ndarray) -> float:
        """Elastic energy [J]."""
        density = elastic_materials.energy_density(self.material, self.deformation(position), self.mu, self.lam)
        return float(self.volume @ density)

    def force(self, position: np.ndarray) -> np.ndarray:
        """Return the negative gradient of the energy: (n, 3) [N]."""
        stress = elastic_materials.stress(self.material, self.deformation(position), self.mu, self.lam)
        each = -np.einsum("m,mij,maj->mai", self.volume, stress, self.gradient).reshape(-1, 3)
        where = self.tetrahedra.ravel()
        return np.stack([np.bincount(where, each[:, axis], minlength=len(position)) for axis in range(3)], axis=1)

    def stiffness(self, position: np.ndarray | None = None, positive: bool = False) -> sparse.csc_matrix:
        """Return the second derivatives of the energy: (3 n, 3 n) [N/m].

        Without a position: at rest, by Hooke's law. `positive`: negative eigenvalues of each tetrahedron's tangent are
        set to 0 (Teran et al., "Robust Quasistatic Finite Elements", SCA 2005).
        """
        if position is None:
            tangent = elastic_materials.linear_tangent(self.mu, self.lam)
        else:
            tangent = elastic_materials.tangent(self.material, self.deformation(position), self.mu, self.lam)
        if positive:
            values, vectors = np.linalg.eigh((tangent + tangent.transpose(0, 2, 1)) / 2)
            tangent = np.einsum("mij,mj,mkj->mik", vectors, np.maximum(values, 0), vectors, optimize=True)
        return self.assembled(tangent)

    def assembled(self, tangent: np.ndarray) -> sparse.csc_matrix:
        """Return the stiffness (3 n, 3 n) [N/m] from tangents dP/dF (m, 9, 9) [Pa]."""
        parts = (self.volume[:, None, None] * tangent).reshape(-1, 3, 3, 3, 3)
        block = np.einsum("maj,mijkl,mbl->maibk", self.gradient, parts, self.gradient, optimize=True)
        number = (3 * self.tetrahedra[:, :, None] + np.arange(3)).reshape(-1, 12)
        row = np.repeat(number, 12, axis=1).ravel()
        column = np.tile(number, (1, 12)).ravel()
        size = 3 * len(self.rest)
        return sparse.coo_matrix((block.ravel(), (row, column)), shape=(size, size)).tocsc()


def free_coordinates(fixed: np.ndarray) -> np.ndarray:
    """Return the numbers 3 vertex + axis of the free coordinates: (free,); `fixed`: (n,) or (n, 3)."""
    fixed = np.asarray(fixed, dtype=bool)
    mask = np.repeat(fixed[:, None], 3, axis=1) if fixed.ndim == 1 else fixed
    return np.flatnonzero(~mask.ravel())


def linear_static(
    position: np.ndarray, tetrahedra: np.ndarray, young: Values, poisson: Values, fixed: np.ndarray, force: np.ndarray,
    fixed_displacement: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Return the displacement at rest under `force` (n, 3) [N] by Hooke's law for small displacements: (n, 3) [m].

    `fixed_displacement` (n, 3) [m]: displacements of the fixed vertices (default: none).
    """
    stiffness = Body.of(position, tetrahedra, "corotated", young, poisson).stiffness()
    free = free_coordinates(fixed)
    moved = np.zeros(position.size) if fixed_displacement is None else np.array(fixed_displacement, float).ravel()
    moved[free] = 0.0
    load = np.asarray(force, dtype=np.float64).ravel() - stiffness @ moved
    moved[free] = splu(stiffness[free][:, free].tocsc()).solve(load[free])
    return moved.reshape(-1, 3)


def mode_shapes(
    position: np.ndarray, tetrahedra: np.ndarray, young: Values, poisson: Values, density: Values, fixed: np.ndarray,
    count: int,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the lowest `count` frequencies (count,) [Hz] and shapes (count, n, 3) of small vibrations.

    Masses are lumped. For a free body they include its six rigid motions, near 0 Hz.
    """
    stiffness = Body.of(position, tetrahedra, "corotated", young, poisson).stiffness()
    free = free_coordinates(fixed)
    root = np.sqrt(np.repeat(lumped_mass(position, tetrahedra, density), 3)[free])
    scaled = sparse.diags(1 / root) @ stiffness[free][:, free] @ sparse.diags(1 / root)
    below = -1e-6 * scaled.diagonal().max()  # the matrix of a free body itself cannot be factorised
    start = np.random.default_rng(0).normal(size=len(free))
    squares, vectors = eigsh(scaled.tocsc(), k=count, sigma=below, v0=start)
    order = np.argsort(squares)
    shapes = np.zeros((count, position.size))
    shapes[:, free] = (vectors / root[:, None]).T[order]
    return np.sqrt(np.maximum(squares[order], 0)) / (2 * np.pi), shapes.reshape(count, -1, 3)


def modes(
    position: np.ndarray, tetrahedra: np.ndarray, young: Values, poisson: Values, density: Values, fixed: np.ndarray,
    count: int,
) -> np.ndarray:  # fmt: skip
    """Return the frequencies of `mode_shapes`: (count,) [Hz]."""
    return mode_shapes(position, tetrahedra, young, poisson, density, fixed, count)[0]


def surface(tetrahedra: np.ndarray) -> np.ndarray:
    """Return the faces that belong to one tetrahedron only, counterclockwise from outside: (triangles, 3)."""
    faces = np.asarray(tetrahedra)[:, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]].reshape(-1, 3)
    _, first, times = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[times == 1])]


def spread_evenly(
    position: np.ndarray, tetrahedra: np.ndarray, on_face: np.ndarray, force: np.ndarray | tuple[float, float, float]
) -> np.ndarray:
    """Return the consistent load (n, 3) [N] of `force` (3,) [N] spread evenly over the surface with vertices `on_face`.

    `on_face`: (n,). Each corner of a triangle gets a third of the triangle's load.
    """
    triangles = surface(tetrahedra)
    triangles = triangles[np.asarray(on_face, dtype=bool)[triangles].all(axis=1)]
    a, b, c = (position[corner] for corner in triangles.T)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    fraction = np.bincount(triangles.ravel(), np.repeat(area / 3, 3), minlength=len(position)) / area.sum()
    return fraction[:, None] * np.asarray(force, dtype=np.float64)
