"""Springs of a grid or a cloth, on the host: their ends, lengths, strains and energies."""

from __future__ import annotations

import numpy as np

from softlab.model.core.family import NO_ARRAYS, Arrays
from softlab.model.scene.scene import Scene

OFFSETS = {  # (rows, columns) from one end of a spring to the other, by kind; a grid's are the structural ones
    "structural": ((0, 1), (1, 0)),
    "shear": ((1, 1), (1, -1)),
    "bending": ((0, 2), (2, 0)),
}


def _both_ends(sheet: np.ndarray, offset: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return views of `sheet` (rows, columns, ...) at the first and at the other ends of the springs in direction
    `offset`."""
    down, across = offset
    rows, columns = max(0, sheet.shape[0] - down), max(0, sheet.shape[1] - abs(across))
    first, other = max(0, -across), max(0, across)
    return sheet[:rows, first : first + columns], sheet[down : down + rows, other : other + columns]


def spring_ends(rows: int, columns: int, kind: str = "structural") -> np.ndarray:
    """Return the particles at the ends of every spring, (springs, 2) int32, horizontal ones row by row, then vertical
    ones.

    `kind` of a cloth's: `bending` in that order too; `shear`: those to the lower right, then those to the lower left.
    """
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    ends = [np.stack([end.ravel() for end in _both_ends(index, offset)], axis=1) for offset in OFFSETS[kind]]
    return np.ascontiguousarray(np.concatenate(ends))


def spring_count(rows: int, columns: int, kind: str = "structural") -> int:
    """Return the number of springs of `spring_ends`."""
    return sum(max(0, rows - down) * max(0, columns - abs(across)) for down, across in OFFSETS[kind])


def sheet_spring_count(scene: Scene) -> int:
    """Return the number of springs of a grid or of a cloth of rows and columns, of every kind."""
    of_grid = scene.grid.spring_count if scene.springs else 0
    return of_grid + sum(spring_count(scene.grid.rows, scene.grid.columns, kind) for kind in scene.cloth_springs)


def spring_stiffness(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return the stiffness [N/m], float64, of the horizontal springs, (1, columns - 1), the same in every row, and of
    the vertical ones, (rows - 1, 1).

    0 in a scene without springs. Where springs alternate, those from an odd column to the next, or an odd row, are the
    stiffer.
    """
    grid, springs = scene.grid, scene.springs
    soft, stiff = (springs.stiffness, springs.largest_stiffness) if springs else (0.0, 0.0)
    across, down = (np.where(np.arange(n - 1) % 2 == 1, stiff, soft) for n in (grid.columns, grid.rows))
    return across[None, :], down[:, None]


def cloth_lengths(scene: Scene, position: np.ndarray, kind: str) -> tuple[np.ndarray, float]:
    """Return (lengths (springs,) [m] of a cloth's springs of a kind, in the order of `spring_ends`; their rest length
    [m])."""
    sheet = np.asarray(position, dtype=np.float64).reshape(scene.grid.rows, scene.grid.columns, 3)
    ends = [_both_ends(sheet, offset) for offset in OFFSETS[kind]]
    lengths = [np.linalg.norm(other - first, axis=-1).ravel() for first, other in ends]
    return np.concatenate(lengths), scene.grid.spacing * float(np.hypot(*OFFSETS[kind][0]))


def _lengths(scene: Scene, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lengths [m] of the horizontal (rows, columns - 1) and vertical (rows - 1, columns) springs."""
    grid = scene.grid
    p = np.asarray(position, dtype=np.float64).reshape(grid.rows, grid.columns, 2)
    across, down = p[:, 1:] - p[:, :-1], p[1:] - p[:-1]
    return np.hypot(across[..., 0], across[..., 1]), np.hypot(down[..., 0], down[..., 1])


def sheet_strain(scene: Scene, position: np.ndarray, kind: str, arrays: Arrays = NO_ARRAYS) -> np.ndarray:
    """Return (length - rest) / rest, (springs,) float64, of the horizontal springs row by row, then of the vertical
    ones.

    With a rest length of zero: length / spacing. In the order of `spring_ends`. A cloth: its springs of that `kind`,
    or, where it has none, the strain that they would have.
    """
    if scene.cloth:
        length, rest = cloth_lengths(scene, position, kind)
        return (length - rest) / rest
    across, down = _lengths(scene, position)
    length = np.concatenate([across.ravel(), down.ravel()])
    rest = scene.springs.rest_length if scene.springs else scene.grid.spacing
    return length / scene.grid.spacing if rest == 0 else (length - rest) / rest


def stored_in_springs(scene: Scene, position: np.ndarray, arrays: Arrays = NO_ARRAYS) -> tuple[float, dict[str, float]]:
    """Return (energy of all springs, a cloth's by kind) [J]: k (length - rest)^2 / 2 of each that is not
    inextensible."""
    springs, stored = scene.springs, 0.0
    if springs and not springs.inextensible:
        for stiffness, length in zip(spring_stiffness(scene), _lengths(scene, position), strict=True):
            stored += 0.5 * float(np.sum(stiffness * (length - springs.rest_length) ** 2))
    by_kind = {}
    for kind, part in scene.cloth_springs.items():
        lengths, rest = cloth_lengths(scene, position, kind)
        by_kind[kind] = 0.5 * part.storing_stiffness * float(np.sum((lengths - rest) ** 2))
    return stored + sum(by_kind.values()), by_kind


def matching_stiffness(scene: Scene) -> float:
    """Return the square of the clusters' angular frequency [1/s^2] that makes the lattice as stiff in a uniform stretch
    as its springs are.

    Stretched by e, a chain of springs stores k (e d)^2 / 2 per mass, a window w^2 m <r^2> e^2 / 2 for its one mass,
    where the mean square of the rest offsets along an axis is <r^2> = d^2 n (n + 1) / 3 for a half-width n: w^2 = 3 k /
    (n (n + 1) m). Windows that are cut off by the edge are softer.
    """
    springs, region = scene.springs, scene.method.region
    return 3 * springs.stiffness / (region * (region + 1) * scene.grid.mass) if springs else 0.0
