"""Small triangle meshes with known counts, for the tests."""

import numpy as np


def sheet(rows: int, columns: int, spacing: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """A flat sheet as a cloth is one: (position (rows * columns, 3), triangles), cells split from their first mass."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    triangles = np.concatenate([np.stack(corners, -1).reshape(-1, 3) for corners in ((a, c, d), (a, d, b))])
    i, j = np.divmod(np.arange(rows * columns), columns)
    return np.stack([j * spacing, -i * spacing, 0.0 * i], axis=1), triangles


def octahedron() -> tuple[np.ndarray, np.ndarray]:
    """Closed: 6 vertices, 12 edges, 8 triangles, outer sides outwards."""
    position = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
    triangles = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    return position, np.array(triangles)


def strip(cells: int, half_turns: int) -> tuple[np.ndarray, np.ndarray]:
    """A closed strip of two rows, turned over `half_turns` times on its way round: with 1 a Moebius strip."""
    angle = 2 * np.pi * np.arange(cells) / cells
    tilt = angle * half_turns / 2
    rows = []
    for side in (-0.3, 0.3):
        radius = 1 + side * np.cos(tilt)
        rows.append(np.stack([radius * np.cos(angle), radius * np.sin(angle), side * np.sin(tilt)], axis=1))
    low, high = np.arange(cells), cells + np.arange(cells)
    next_low, next_high = np.roll(low, -1), np.roll(high, -1)
    if half_turns % 2:
        next_low[-1], next_high[-1] = cells, 0
    triangles = np.concatenate([np.stack([low, next_low, high], 1), np.stack([high, next_low, next_high], 1)])
    return np.concatenate(rows), triangles
