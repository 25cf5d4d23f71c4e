"""OFF, the text format of Geomview: vertices and polygons. Normals, colours and texture coordinates are skipped."""

from __future__ import annotations

import re

import numpy as np

from model.core.errors import InputError
from model.geometry.formats.faces import Faces
from model.geometry.formats.source import NotANumber, plain, reals, wholes, without_comments, word

KEYWORD = re.compile(rb"\s*(?:ST)?C?N?OFF\b\s*|\s*OFF(?=\d)", re.IGNORECASE)


def read_off(data: bytes) -> Faces:
    """Return the faces of an OFF file. Raises InputError: binary or of four dimensions, cut short, words for numbers."""
    text = without_comments(plain(data))
    keyword = KEYWORD.match(text)
    if keyword is None or text[keyword.end() :].lstrip()[:6].upper() == b"BINARY":
        raise InputError("it cannot be read as OFF: it does not begin with OFF, or is binary; export it as text")
    lines = [(number, line.split()) for number, line in enumerate(text.split(b"\n"), 1)]
    if lines:
        skipped = text.count(b"\n", 0, keyword.end())
        rest = text[keyword.end() :].split(b"\n", 1)[0].split()
        lines = [(skipped + 1, rest), *lines[skipped + 1 :]]
    rows = [(number, words) for number, words in lines if words]
    if not rows or len(rows[0][1]) < 2:
        raise InputError("it cannot be read as OFF: it has no counts of vertices and faces; export it again")
    try:
        vertices, faces = wholes(rows[0][1][:2], 2).tolist()
    except NotANumber as error:
        raise InputError(f"it cannot be read as OFF: {error.message} (line {rows[0][0]}); export it again") from None
    if vertices < 0 or faces < 0 or len(rows) < 1 + vertices + faces:
        raise InputError(
            f"{vertices} vertices and {faces} faces promised, {len(rows) - 1} lines found: cut short; export it again"
        )
    points, polygons = rows[1 : 1 + vertices], rows[1 + vertices : 1 + vertices + faces]
    short = next((number for number, words in points if len(words) < 3), None)
    if short is not None:
        raise InputError(f"vertices of fewer than three coordinates, the first in line {short}; export it again")
    try:
        position = reals([token for _, words in points for token in words[:3]], 3 * vertices).reshape(-1, 3)
    except NotANumber as error:
        where = points[error.number // 3][0]
        raise InputError(f"it cannot be read as OFF: {error.message} (line {where}); export it again") from None
    corners, sizes = _polygons(polygons)
    return Faces(position, corners, sizes, lambda k: f"line {points[k][0]}", lambda k: f"line {polygons[k][0]}")


def _polygons(polygons: list[tuple[int, list[bytes]]]) -> tuple[np.ndarray, np.ndarray]:
    corners: list[bytes] = []
    sizes = np.zeros(len(polygons), np.int64)
    for k, (number, words) in enumerate(polygons):
        size = int(words[0]) if words[0].isdigit() else -1
        if size < 3 or size >= len(words):
            raise InputError(
                f"line {number} is no face of three corners or more ({word(b' '.join(words))}): damaged or cut short; export "
                "it again"
            )
        sizes[k] = size
        corners += words[1 : 1 + size]
    try:
        return wholes(corners, len(corners)), sizes
    except NotANumber as error:
        where = polygons[int(np.searchsorted(np.cumsum(sizes), error.number, "right"))][0]
        raise InputError(f"it cannot be read as OFF: {error.message} (line {where}); export it again") from None
