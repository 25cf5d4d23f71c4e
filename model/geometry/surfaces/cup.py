"""A cup: a closed surface of revolution, open at its top."""

from __future__ import annotations

from math import pi

import numpy as np

from softlab.model.geometry.arithmetic.functions import cosine, sine

RADIUS, HEIGHT, WALL = 0.4, 1.0, 0.05  # m: of its outer side; how thick walls and bottom are


def cup(resolution: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (position (vertices, 3) [m], triangles (n, 3) int32, outer sides outwards) of a cup about the origin, y
    up, with so many edges to a metre: a line from the middle of its foot round the rim to the middle of its bottom
    inside goes round y."""
    up = np.linspace(-HEIGHT / 2, HEIGHT / 2, max(1, round(HEIGHT * resolution)) + 1)
    inside = np.linspace(HEIGHT / 2, -HEIGHT / 2 + WALL, len(up))
    outer, inner = RADIUS, RADIUS - WALL
    steps = max(1, round(inner * resolution))
    foot_out, bottom_in = (radius / steps * np.arange(1, steps) for radius in (outer, inner))
    line = np.concatenate([
        np.stack([foot_out, np.full(steps - 1, up[0])], 1), np.stack([np.full(len(up), outer), up], 1),
        np.stack([np.full(len(up), inner), inside], 1), np.stack([bottom_in[::-1], np.full(steps - 1, inside[-1])], 1),
    ])  # fmt: skip
    around = max(6, round(2 * pi * RADIUS * resolution))
    angle = (2 * pi / around * np.arange(around))[:, None]
    far, height = line[:, 0][None], line[:, 1][None]
    position = np.stack([far * cosine(angle), height + 0 * angle, far * sine(angle)], -1).reshape(-1, 3)
    middles = np.array([[0.0, -HEIGHT / 2, 0.0], [0.0, -HEIGHT / 2 + WALL, 0.0]])
    first = np.arange(around * len(line)).reshape(around, len(line))
    second = np.roll(first, -1, axis=0)
    a, b, c, d = first[:, :-1], first[:, 1:], second[:, 1:], second[:, :-1]
    sides = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    foot, bottom = len(position), len(position) + 1
    fans = [
        np.stack([first[:, 0], second[:, 0], np.full(around, foot)], -1),
        np.stack([second[:, -1], first[:, -1], np.full(around, bottom)], -1),
    ]
    return np.concatenate([position, middles]), np.concatenate([sides, *fans]).astype(np.int32)
