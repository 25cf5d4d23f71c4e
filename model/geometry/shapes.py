"""Meshes of the lab's own, made by code: closed, outer sides outwards, about a metre across, the same on every call. A sheet
and a terrain, 8 m across, are open, with their upper side outwards."""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import Literal

import numpy as np
from pydantic import model_validator

from softlab.model.base.table import Count, Part, Positive
from softlab.model.geometry.arithmetic.functions import cosine, power, sine
from softlab.model.geometry.mesh import TriangleMesh, triangle_mesh
from softlab.model.geometry.sheets import cell_corners, sheet_triangles
from softlab.model.geometry.strokes import blended, extruded, letters, outline, polygon, tube, union
from softlab.model.geometry.surfaces.cup import cup
from softlab.model.geometry.surfaces.surface_nets import Field, surface

ShapeName = Literal[
    "star", "torus", "beam", "blob", "octopus", "letters", "sheet", "terrain", "box", "ball", "pipe", "creature", "cup"
]  # fmt: skip

FINEST, FINEST_TERRAIN = 200, 40
COARSEST = {
    "star": 16,
    "torus": 8,
    "beam": 1,
    "blob": 24,
    "octopus": 32,
    "letters": 16,
    "sheet": 1,
    "terrain": 2,
    "box": 1,
    "ball": 8,
    "pipe": 8,
    "creature": 40,
    "cup": 2,
}  # what their thinnest parts ask for
BEAM, BOX = (1.0, 0.25, 0.25), (1.0, 1.0, 1.0)  # m
TORUS = (0.35, 0.15)  # m: of the ring, of its tube
BALL, PIPE = 0.5, (0.2, 0.35, 1.0)  # m: its radius; the inner, the outer radius, the length
STAR_DEPTH, STAR_TIP, STAR_NOTCH = 0.24, 0.52, 0.25  # m: from front to back; from the middle
LETTER_DEPTH, LETTER_WIDTH = 0.22, 0.22  # m: from front to back; of a stroke
EDGE = 0.05  # m: the radius of edges of what is cut from a plate
TERRAIN, TERRAIN_RIM = 8.0, 0.5  # m: its sides; how far their middles are raised
GAP = 0.25  # m: between letters: clusters of up to that radius do not reach across


class Shape(Part):
    """One of the lab's meshes: a star of five points, a torus, a beam 1 m x 0.25 m x 0.25 m, a blob with ears, an octopus,
    letters a metre tall, a sheet of a square metre, a terrain of gentle hills, 8 m x 8 m, with a raised rim, a box, a ball, a
    pipe, a creature that stands, with fingers, or a cup 1 m high and 0.8 m across, of walls 5 cm thick.

    `resolution`: edges of triangles to a metre, roughly; `scale`: times its size; `text` of letters: up to 16
    of A B E F J L O S T Y; `sides` of a box [m]: a cube of a metre unless given.
    """

    name: ShapeName
    resolution: Count = 40
    scale: Positive = 1.0
    text: str | None = None
    sides: tuple[Positive, Positive, Positive] | None = None  # m

    @model_validator(mode="after")
    def _check_shape(self) -> Shape:
        least, most = COARSEST[self.name], FINEST_TERRAIN if self.name == "terrain" else FINEST
        if not least <= self.resolution <= most:
            raise ValueError(f"resolution: a {self.name} takes {least} to {most} edges to a metre")
        if (self.text is not None) != (self.name == "letters"):
            raise ValueError('text: belongs to name = "letters", and to no other')
        if self.sides is not None and self.name != "box":
            raise ValueError('sides: belong to name = "box"; other shapes have a scale')
        if self.text is not None and not (0 < len(self.text) <= 16 and set(self.text) <= set(letters())):
            raise ValueError(f"text: 1 to 16 of the letters {' '.join(letters())}")
        return self

    def _idle_fields(self) -> set[str]:
        return {"sides"} if self.sides is None else set()

    def mesh(self) -> TriangleMesh:
        """Return the mesh, around the origin, y up; letters side by side along x, a piece each."""
        position, triangles = MAKERS[self.name](self)
        return triangle_mesh(position * self.scale, triangles)


def _net(
    field: Field, low: tuple[float, ...], high: tuple[float, ...], resolution: int
) -> tuple[np.ndarray, np.ndarray]:
    return surface(field, np.array(low), np.array(high), 1 / resolution)


def _halves(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return (2 n, 3): quadrilaterals by the numbers of their corners, in their order round them, each cut from a to c:
    first all halves with b, then all with d."""
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])


def _star(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """A filled star with sharp corners in its outline, drawn by a pen with a round tip: the corners of the body are
    round."""
    angles = [pi / 2 + k * pi / 5 for k in range(10)]
    radii = [STAR_TIP - EDGE, STAR_NOTCH - EDGE] * 5
    corners = np.array([(r * cosine(a), r * sine(a)) for r, a in zip(radii, angles, strict=True)])
    field = extruded(polygon(corners, EDGE), STAR_DEPTH, EDGE)
    return _net(field, (-STAR_TIP, -STAR_TIP, -STAR_DEPTH / 2), (STAR_TIP, STAR_TIP, STAR_DEPTH / 2), shape.resolution)


def _ball(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    end = BALL + 0.05
    return _net(tube([(0, 0, 0), (0, 0, 1e-3)], [BALL, BALL]), (-end, -end, -end), (end, end, end), shape.resolution)


def _pipe(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """A rectangle swept around the y axis, as a parametric surface that is periodic in both directions."""
    inner, outer, length = PIPE
    along, thick = (max(1, round(n * shape.resolution)) for n in (length, outer - inner))
    up, out = np.linspace(-length / 2, length / 2, along + 1), np.linspace(inner, outer, thick + 1)
    profile = np.concatenate([
        np.stack([np.full(along, outer), up[:-1]], 1), np.stack([out[:0:-1], np.full(thick, up[-1])], 1),
        np.stack([np.full(along, inner), up[:0:-1]], 1), np.stack([out[:-1], np.full(thick, up[0])], 1),
    ])  # fmt: skip
    around = max(3, round(2 * pi * outer * shape.resolution))
    u = (2 * pi / around * np.arange(around))[:, None]
    far, height = profile[:, 0][None], profile[:, 1][None]
    position = np.stack([far * cosine(u), height + 0 * u, far * sine(u)], axis=-1)
    a = np.arange(around * len(profile)).reshape(around, len(profile))
    b, d = np.roll(a, -1, axis=0), np.roll(a, -1, axis=1)
    return position.reshape(-1, 3), _halves(a, d, np.roll(b, -1, axis=1), b).astype(np.int32)


def _torus(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """A torus about the y axis, as a parametric surface that is periodic in both directions."""
    ring, tube_radius = TORUS
    around, across = (max(3, round(2 * pi * radius * shape.resolution)) for radius in TORUS)
    u = (2 * pi / around * np.arange(around))[:, None]
    v = (2 * pi / across * np.arange(across))[None]
    far = ring + tube_radius * cosine(v)
    position = np.stack([far * cosine(u), tube_radius * sine(v) + 0 * u, far * sine(u)], axis=-1)
    a = np.arange(around * across).reshape(around, across)
    b, d = np.roll(a, -1, axis=0), np.roll(a, -1, axis=1)
    return position.reshape(-1, 3), _halves(a, d, np.roll(b, -1, axis=1), b).astype(np.int32)


def _beam(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    return _cuboid(BEAM, shape.resolution)


def _box(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    return _cuboid(shape.sides or BOX, shape.resolution)


def _cuboid(sides: tuple[float, float, float], resolution: int) -> tuple[np.ndarray, np.ndarray]:
    """Six sides of square cells that share their corners."""
    counts = np.array([max(1, round(length * resolution)) for length in sides])
    places, triangles, used = [], [], 0
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        i, j = np.meshgrid(np.arange(counts[one] + 1), np.arange(counts[two] + 1), indexing="ij")
        a, d, b, c = cell_corners(np.arange(i.size).reshape(i.shape))
        cells = _halves(a, b, c, d)
        for end in (0, counts[axis]):
            place = np.empty((i.size, 3), dtype=np.int64)
            place[:, axis], place[:, one], place[:, two] = end, i.ravel(), j.ravel()
            places.append(place)
            triangles.append(used + (cells if end else cells[:, ::-1]))
            used += i.size
    corners, number = np.unique(np.concatenate(places), axis=0, return_inverse=True)
    return (corners / counts - 0.5) * sides, number.reshape(-1)[np.concatenate(triangles)].astype(np.int32)


def _blob(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """A rounded sitting hare that faces +z."""
    body = tube([(0, -0.2, -0.08), (0, -0.02, -0.02)], [0.27, 0.22])
    head = tube([(0, 0.16, 0.14), (0, 0.13, 0.24)], [0.16, 0.1])
    ears = [tube([(x * 0.07, 0.25, 0.1), (x * 0.14, 0.47, 0.0)], [0.05, 0.045]) for x in (-1, 1)]
    paws = [tube([(x * 0.15, -0.41, 0.05), (x * 0.17, -0.42, 0.26)], [0.08, 0.065]) for x in (-1, 1)]
    tail = tube([(0, -0.3, -0.36), (0, -0.3, -0.37)], [0.08, 0.08])
    field = blended([body, head, *ears, *paws, tail], 0.06)
    return _net(field, (-0.4, -0.55, -0.5), (0.4, 0.55, 0.4), shape.resolution)


def _sheet(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """A square metre in the plane y = 0, its cells cut along alternating diagonals, so that no direction is stiffer."""
    count = shape.resolution
    z, x = np.meshgrid(np.linspace(-0.5, 0.5, count + 1), np.linspace(-0.5, 0.5, count + 1), indexing="ij")
    triangles = sheet_triangles(count + 1, count + 1, "alternating").astype(np.int32)
    return np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1), triangles


def _octopus(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """A head with eight tapering arms that run down and outwards and curl up at their ends."""
    parts = [tube([(0, 0.16, -0.03), (0, 0.03, 0)], [0.2, 0.16])]
    along = np.linspace(0, 1, 11)
    for k in range(8):
        angle = (k + 0.5) * pi / 4
        away = 0.1 + 0.38 * along
        height = -0.06 - 0.62 * along + 0.66 * power(along, 2.6)
        sway = 0.05 * sine(2 * pi * along + k)
        x, z = away * sine(angle) + sway * cosine(angle), away * cosine(angle) - sway * sine(angle)
        parts.append(tube(np.stack([x, height, z], axis=1), 0.075 - 0.045 * along))
    return _net(blended(parts, 0.03), (-0.6, -0.5, -0.6), (0.6, 0.4, 0.6), shape.resolution)


def _creature(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """A creature that stands on two feet and its tail, with both arms stretched out. Gaps between fingers and between
    toes are 2 to 4 cm."""
    parts = [
        tube([(0, 0.0, -0.02), (0, 0.24, 0.02)], [0.2, 0.15]),
        tube([(0, 0.44, 0.07), (0, 0.41, 0.22)], [0.12, 0.06]),
        tube([(0, -0.1, -0.15), (0, -0.36, -0.34), (0, -0.47, -0.56)], [0.11, 0.07, 0.03]),
    ]
    for x in (-1, 1):
        parts.append(tube([(x * 0.07, 0.53, 0.04), (x * 0.13, 0.64, 0.0)], [0.05, 0.03]))
        parts.append(tube([(x * 0.13, 0.28, 0.02), (x * 0.36, 0.2, 0.1), (x * 0.45, 0.2, 0.3)], [0.08, 0.06, 0.07]))
        parts.append(tube([(x * 0.13, -0.1, 0.0), (x * 0.17, -0.28, 0.06), (x * 0.17, -0.46, 0.0)], [0.12, 0.09, 0.08]))
        parts.append(tube([(x * 0.17, -0.48, 0.0), (x * 0.18, -0.49, 0.14)], [0.06, 0.06]))
    fingers = []
    for x in (-1, 1):
        for n in (-1, 0, 1):
            hand, tip = (x * 0.45, 0.2 + 0.06 * n, 0.26), (x * 0.45, 0.2 + 0.11 * n, 0.52)
            fingers.append(tube([hand, tip], [0.03, 0.026]))
            toe, end = (x * 0.18 + 0.05 * n, -0.51, 0.1), (x * 0.18 + 0.11 * n, -0.51, 0.3)
            fingers.append(tube([toe, end], [0.03, 0.026]))
    field = union([blended(parts, 0.03), *fingers])
    return _net(lambda points: field(points / 0.85), (-0.5, -0.5, -0.55), (0.5, 0.6, 0.5), shape.resolution)


def _letters(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Letters, each on a lattice of its own: a letter has the same vertices in every text."""
    positions, triangles, x, used = [], [], 0.0, 0
    for letter in shape.text or "":
        strokes = letters()[letter]
        points = np.concatenate(strokes)
        low, high = points.min(axis=0) - LETTER_WIDTH / 2, points.max(axis=0) + LETTER_WIDTH / 2
        field = extruded(union([outline(stroke, LETTER_WIDTH / 2) for stroke in strokes]), LETTER_DEPTH, EDGE)
        ends = (*low, -LETTER_DEPTH / 2), (*high, LETTER_DEPTH / 2)
        position, part = _net(field, *ends, shape.resolution)
        positions.append(position + np.array([x - low[0], 0, 0]))
        triangles.append(part + used)
        used += len(position)
        x += float(high[0] - low[0]) + GAP
    return np.concatenate(positions) - np.array([(x - GAP) / 2, 0, 0]), np.concatenate(triangles)


def _terrain(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """A height field over a square: waves of three lengths and directions, and a rim; slopes up to 45 degrees."""
    count = round(TERRAIN * shape.resolution) + 1
    along = TERRAIN * (np.arange(count) / (count - 1) - 0.5)
    x, z = along[None], along[:, None]
    height = 0.3 * sine(1.1 * x + 0.4) * cosine(0.8 * z)
    height += 0.15 * sine(1.6 * x - 1.3 * z) + 0.1 * cosine(2.3 * z + x)
    height += TERRAIN_RIM * (((2 * x / TERRAIN) ** 2) ** 2 + ((2 * z / TERRAIN) ** 2) ** 2)
    position = np.stack([x + 0 * z, height, z + 0 * x], axis=-1)
    a, d, b, c = cell_corners(np.arange(count * count).reshape(count, count))
    return position.reshape(-1, 3), _halves(a, b, c, d).astype(np.int32)


MAKERS: dict[str, Callable[[Shape], tuple[np.ndarray, np.ndarray]]] = {
    "star": _star,
    "torus": _torus,
    "beam": _beam,
    "blob": _blob,
    "octopus": _octopus,
    "letters": _letters,
    "terrain": _terrain,
    "sheet": _sheet,
    "box": _box,
    "ball": _ball,
    "pipe": _pipe,
    "creature": _creature,
    "cup": lambda shape: cup(shape.resolution),
}
