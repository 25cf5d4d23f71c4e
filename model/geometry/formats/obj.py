"""Wavefront OBJ: `v` and `f` lines. Texture coordinates, normals, materials, groups, lines and points are skipped."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import chain

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.formats.faces import Faces
from softlab.model.geometry.formats.source import (
    joined,
    line_of,
    plain,
    reals,
    refusal,
    row_of,
    table,
    whole_table,
    wholes,
    without_comments,
)

VERTEX = rb"^[ \t]*v(?=[ \t]|$)[ \t]*(.*)$"
FACE = rb"^[ \t]*f(?=[ \t]|$)[ \t]*(.*)$"
EITHER = rb"^[ \t]*([vf])(?=[ \t]|$)"


def read_obj(data: bytes) -> Faces:
    """Return the faces of an OBJ file. Negative indices count back from the last vertex read before the face. Raises
    InputError."""
    text = joined(without_comments(plain(data)))
    vertices, faces = re.findall(VERTEX, text, re.MULTILINE), re.findall(FACE, text, re.MULTILINE)

    def vertex_line(number: int) -> str:
        return line_of(text, VERTEX, number)

    def face_line(number: int) -> str:
        return line_of(text, FACE, number)

    parsed = table(vertices, 3)
    position = _points(vertices, vertex_line) if parsed is None else np.ascontiguousarray(parsed[:, :3])
    named, sizes = _polygons(faces, face_line)
    corners = _corners(text, named, sizes, len(position), face_line)
    return Faces(position, corners, sizes, vertex_line, face_line, first=1)


def _points(vertices: list[bytes], vertex_line: Callable[[int], str]) -> np.ndarray:
    """Return (vertices, 3) float64 of `v` lines."""
    rows = [line.split(None, 3)[:3] for line in vertices]
    short = [number for number, row in enumerate(rows) if len(row) < 3]
    if short:
        raise InputError(
            f"vertices of fewer than three coordinates: {len(short)}, the first in {vertex_line(short[0])}; export it again"
        )
    refused = refusal("OBJ", lambda token: vertex_line(token // 3))
    return reals(chain.from_iterable(rows), 3 * len(rows), refused).reshape(-1, 3)


def _polygons(faces: list[bytes], face_line: Callable[[int], str]) -> tuple[np.ndarray, np.ndarray]:
    """Return (vertices as the file numbers them, sizes) of `f` lines."""
    lines = re.sub(rb"/[^\s]*", b"", b"\n".join(faces)).split(b"\n") if faces else []
    same = whole_table(lines, 3)
    if same is not None:
        return same.ravel(), np.full(len(same), same.shape[1], np.int64)
    tokens = [line.split() for line in lines]
    sizes = np.fromiter(map(len, tokens), np.int64, len(tokens))
    if len(sizes) and sizes.min() < 3:
        raise InputError(
            f"faces of fewer than three corners: {int((sizes < 3).sum())}, the first in "
            f"{face_line(int(np.argmax(sizes < 3)))}; remove them, or export it again"
        )
    refused = refusal("OBJ", lambda token: face_line(row_of(token, sizes)))
    return wholes(chain.from_iterable(tokens), int(sizes.sum()), refused), sizes


def _corners(
    text: bytes, named: np.ndarray, sizes: np.ndarray, vertices: int, face_line: Callable[[int], str]
) -> np.ndarray:
    """Return vertices counted from 0 for indices as OBJ has them: from 1, or negative."""
    face = np.repeat(np.arange(len(sizes)), sizes)
    zero = named == 0
    if zero.any():
        raise InputError(
            f"a face names vertex 0, and OBJ counts from 1 ({face_line(int(face[np.argmax(zero)]))}); export it again"
        )
    behind = named < 0
    if not behind.any():
        return named - 1
    kinds = np.frombuffer(b"".join(re.findall(EITHER, text, re.MULTILINE)), np.uint8)
    before = np.cumsum(kinds == ord("v"))[kinds == ord("f")][face]  # vertices that stand before each corner's face
    corners = np.where(behind, before + named, named - 1)
    below = corners < 0
    if below.any():
        first = int(np.argmax(below))
        raise InputError(
            f"a face names vertex {named[first]}, counted from the end, and {before[first]} of {vertices} vertices stand "
            f"before it ({face_line(int(face[first]))}); the file is damaged or cut short: export it again"
        )
    return corners
