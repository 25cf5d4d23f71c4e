"""OFF, the text format of Geomview: vertices and polygons. Normals, colours and texture coordinates are skipped."""

from __future__ import annotations

import re

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.base.waiting import steps
from softlab.model.geometry.formats.faces import Faces
from softlab.model.geometry.formats.source import (
    READING,
    plain,
    polygon_table,
    reals,
    refusal,
    row_of,
    table,
    wholes,
    without_comments,
    word,
)

KEYWORD = re.compile(rb"\s*(?:ST)?C?N?OFF\b\s*|\s*OFF(?=\d)", re.IGNORECASE)


def read_off(data: bytes) -> Faces:
    """Return the faces of an OFF file. Raises InputError: binary or of four dimensions, cut short, words for numbers."""
    text = without_comments(plain(data))
    keyword = KEYWORD.match(text)
    if keyword is None or text[keyword.end() :].lstrip()[:6].upper() == b"BINARY":
        raise InputError("it cannot be read as OFF: it does not begin with OFF, or is binary; export it as text")
    skipped = text.count(b"\n", 0, keyword.end())
    lines = enumerate(text[keyword.end() :].split(b"\n"), skipped + 1)
    rows = [(number, line) for number, line in lines if line.strip()]
    if not rows or len(rows[0][1].split()) < 2:
        raise InputError("it cannot be read as OFF: it has no counts of vertices and faces; export it again")
    vertices, faces = wholes(rows[0][1].split()[:2], 2, refusal("OFF", lambda _: f"line {rows[0][0]}")).tolist()
    if vertices < 0 or faces < 0 or len(rows) < 1 + vertices + faces:
        raise InputError(
            f"{vertices} vertices and {faces} faces promised, {len(rows) - 1} lines found: cut short; export it again"
        )
    points, polygons = rows[1 : 1 + vertices], rows[1 + vertices : 1 + vertices + faces]
    parsed, same = table([line for _, line in points], 3), polygon_table([line for _, line in polygons])
    position = _points(points) if parsed is None else np.ascontiguousarray(parsed[:, :3])
    if same is None:
        corners, sizes = _polygons(polygons)
    else:
        corners, sizes = same.ravel(), np.full(len(same), same.shape[1], np.int64)
    return Faces(position, corners, sizes, lambda k: f"line {points[k][0]}", lambda k: f"line {polygons[k][0]}")


def _points(points: list[tuple[int, bytes]]) -> np.ndarray:
    """Return (vertices, 3) float64 of numbered lines."""
    rows = [line.split()[:3] for _, line in points]
    short = next((number for (number, _), row in zip(points, rows, strict=True) if len(row) < 3), None)
    if short is not None:
        raise InputError(f"vertices of fewer than three coordinates, the first in line {short}; export it again")
    refused = refusal("OFF", lambda token: f"line {points[token // 3][0]}")
    return reals([token for row in rows for token in row], 3 * len(rows), refused).reshape(-1, 3)


def _polygons(polygons: list[tuple[int, bytes]]) -> tuple[np.ndarray, np.ndarray]:
    """Return (corners, sizes) of numbered lines."""
    corners: list[bytes] = []
    sizes = np.zeros(len(polygons), np.int64)
    for k, (number, line) in enumerate(steps(polygons, len(polygons), READING)):
        words = line.split()
        size = int(words[0]) if words[0].isdigit() else -1
        if size < 3 or size >= len(words):
            raise InputError(
                f"line {number} is no face of three corners or more ({word(b' '.join(words))}): damaged or cut short; export "
                "it again"
            )
        sizes[k] = size
        corners += words[1 : 1 + size]
    refused = refusal("OFF", lambda token: f"line {polygons[row_of(token, sizes)][0]}")
    return wholes(corners, len(corners), refused), sizes
