"""Bars of voxels that are cut into tetrahedra, made here and not by the lab's mesher: it is judged on them, too."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

# corners of a voxel: bit 0 x, bit 1 y, bit 2 z. Five: one in the middle, then four at corners; odd voxels are mirrored
FIVE = ((0, 3, 6, 5), (1, 0, 3, 5), (2, 0, 6, 3), (4, 0, 5, 6), (7, 3, 5, 6))


def _six() -> tuple[tuple[int, ...], ...]:
    """Kuhn's: a way from corner 0 to corner 7 for each order of the three axes."""
    ways = []
    for order in permutations((1, 2, 4)):
        corners = [0]
        for bit in order:
            corners.append(corners[-1] | bit)
        ways.append(tuple(corners))
    return tuple(ways)


@dataclass(frozen=True)
class Bar:
    """`position` (n, 3) [m] from x = 0, its middle line on the x axis; `tetrahedra` (m, 4) of positive volume, voxel after
    voxel; `colours`: sets of tetrahedra without a common vertex, by their voxel's parities, then their place in it."""

    position: np.ndarray
    tetrahedra: np.ndarray
    colours: list[np.ndarray]

    @property
    def clamped(self) -> np.ndarray:
        """(n,): the vertices of the end x = 0."""
        return self.position[:, 0] < 1e-9

    @property
    def tip(self) -> np.ndarray:
        """(n,): the vertices of the other end."""
        return self.position[:, 0] > self.position[:, 0].max() - 1e-9


def positive(position: np.ndarray, tetrahedra: np.ndarray) -> np.ndarray:
    """The tetrahedra with the last two corners of those swapped that are inside out."""
    corners = position[tetrahedra]
    inside_out = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0
    turned = tetrahedra.copy()
    turned[inside_out, 2:] = tetrahedra[inside_out, :1:-1]
    return turned


def bar(across: int, per_voxel: int = 5, length: float = 1.0, side: float = 0.1) -> Bar:
    """`across` voxels along each side of the square section, cubes; `per_voxel`: 5 (mirrored by parity) or 6 tetrahedra."""
    counts = np.array([round(length / side * across), across, across])
    x, y, z = (np.arange(count + 1) for count in counts)
    lattice = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    position = lattice.reshape(-1, 3) * (side / across)
    position[:, 1:] -= side / 2
    number = np.arange(len(position)).reshape(lattice.shape[:3])
    voxels = np.stack(np.meshgrid(*(np.arange(count) for count in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    bits = np.array([[corner & 1, corner >> 1 & 1, corner >> 2 & 1] for corner in range(8)])
    corners = number[tuple((voxels[:, None, :] + bits).transpose(2, 0, 1))]
    pattern = np.array(FIVE if per_voxel == 5 else _six())
    cut = corners[:, pattern]
    if per_voxel == 5:  # the other diagonal of each face, by a mirror along x
        odd = voxels.sum(axis=1) % 2 == 1
        cut[odd] = corners[odd][:, pattern ^ 1]
    tetrahedra = positive(position, cut.reshape(-1, 4))
    parity = voxels % 2 @ np.array([1, 2, 4])
    colours = [
        np.flatnonzero(parity == colour) * per_voxel + place for colour in range(8) for place in range(per_voxel)
    ]
    return Bar(position, tetrahedra, [members for members in colours if len(members)])


def cube(sides: int = 2, side: float = 0.1, jitter: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(position, tetrahedra) of `sides`^3 voxels of five; `jitter`: of a voxel's side, how far inner vertices are moved."""
    made = bar(sides, 5, length=side, side=side)
    position = made.position.copy()
    inside = (np.abs(position[:, 1:]) < side / 2 - 1e-9).all(axis=1)
    inside &= (position[:, 0] > 1e-9) & (position[:, 0] < side - 1e-9)
    shift = np.random.default_rng(1).uniform(-1, 1, position.shape) * jitter * side / sides
    position[inside] += shift[inside]
    return position, made.tetrahedra
