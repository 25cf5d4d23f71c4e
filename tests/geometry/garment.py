"""A garment of the lab's own: a tunic, cut as two flat T shapes and sewn together where it is worn closed.

Front and back are the same pattern of square cells, two triangles each. They share the vertices of their seams: shoulders,
under the arms, sides. Neck, cuffs and hem stay open, four rims in all.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from softlab.model.geometry.arithmetic.functions import sine
from softlab.model.geometry.sheets import split_cells

DECIMALS = 4  # of the file: a tenth of a millimetre


@dataclass(frozen=True)
class Tunic:
    """The pattern, in cells of `cell` [m]: a body `width` x `height`, sleeves `sleeve` long and `cuff` deep at its top, a
    neck `neck` wide. `flare`: the hem's width over the chest's, less 1. `slope`: how much lower a cuff lies than the neck,
    per length; the hem is level."""

    cell: float = 0.02
    width: int = 26
    height: int = 44
    sleeve: int = 12
    cuff: int = 10
    neck: int = 10
    flare: float = 0.4
    slope: float = 0.3

    def inside(self) -> np.ndarray:
        """(rows, columns) bool: the cells of the T, row 0 on top."""
        cells = np.zeros((self.height, self.width + 2 * self.sleeve), dtype=bool)
        cells[: self.cuff] = True
        cells[:, self.sleeve : self.sleeve + self.width] = True
        return cells

    def sewn(self) -> np.ndarray:
        """(rows + 1, columns + 1) bool: the corners of cells where front and back are one."""
        left, right = self.sleeve, self.sleeve + self.width
        columns = self.width + 2 * self.sleeve
        seam = np.zeros((self.height + 1, columns + 1), dtype=bool)
        seam[0] = True
        seam[0, (columns - self.neck) // 2 + 1 : (columns + self.neck) // 2] = False
        seam[self.cuff, : left + 1] = seam[self.cuff, right:] = True
        seam[self.cuff :, [left, right]] = True
        return seam


def make_tunic(tunic: Tunic | None = None) -> tuple[np.ndarray, np.ndarray]:
    """(position (vertices, 3) float64 [m], triangles (n, 3) int32): y up, the front towards +z, outer sides outwards.

    Rounded to DECIMALS, as its file is.
    """
    tunic = tunic or Tunic()
    cells, seam = tunic.inside(), tunic.sewn()
    row, column = (index.astype(np.float64) for index in np.indices(seam.shape))
    used = np.zeros(seam.shape, dtype=bool)
    for down in (0, 1):
        for across in (0, 1):
            used[down : down + cells.shape[0], across : across + cells.shape[1]] |= cells
    x = (column - column.mean()) * tunic.cell
    below = np.clip((row - tunic.cuff) / (tunic.height - tunic.cuff), 0, 1)
    y = -row * tunic.cell - tunic.slope * np.maximum(np.abs(x) - tunic.neck / 2 * tunic.cell, 0) * (1 - below)
    # halfway round a sleeve, so that its section is one arch of a sine to either side
    depth = tunic.cuff / 2
    z = depth * tunic.cell * sine(pi / 2 * np.minimum(_distance_to(seam) / depth, 1)) * (1 + tunic.flare * below)
    x = x * (1 + tunic.flare * below)
    front = np.full(seam.shape, -1)
    front[used] = np.arange(used.sum())
    back = front.copy()
    own = used & ~seam
    back[own] = used.sum() + np.arange(own.sum())
    position = np.concatenate([np.stack([x, y, z], -1)[used], np.stack([x, y, -z], -1)[own]])
    triangles = np.concatenate([_triangles(front, cells), _triangles(back, cells)[:, ::-1]])
    return np.round(position, DECIMALS) + 0.0, triangles.astype(np.int32)


def _distance_to(seam: np.ndarray) -> np.ndarray:
    """Distance in cells from each corner to the nearest one that is sewn."""
    rows, columns = np.nonzero(seam)
    down = np.arange(seam.shape[0])[:, None, None] - rows
    across = np.arange(seam.shape[1])[None, :, None] - columns
    return np.sqrt((down**2 + across**2).min(axis=-1))


def _triangles(number: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(2 cells, 3): counter-clockwise seen from +z, diagonals of the right half mirrored to those of the left."""
    right = np.arange(cells.shape[1]) >= cells.shape[1] / 2
    return split_cells(number, right)[cells].reshape(-1, 3)


def obj_text(position: np.ndarray, triangles: np.ndarray, title: str) -> str:
    """An OBJ file of the mesh: vertices (n, 3) [m] to DECIMALS, triangles (m, 3) of indices from 0."""
    lines = [f"# {title}", "# m; y up; made by tests/geometry/garment.py"]
    lines += [
        "v " + " ".join(f"{x:.{DECIMALS}f}".rstrip("0").rstrip(".") for x in point) for point in position.tolist()
    ]
    lines += ["f " + " ".join(str(corner + 1) for corner in triangle) for triangle in triangles.tolist()]
    return "\n".join(lines) + "\n"
