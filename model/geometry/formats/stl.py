"""STL, binary and text: three vertices of its own for each triangle; all solids of a text."""

from __future__ import annotations

import re

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.formats.faces import Faces, uniform
from softlab.model.geometry.formats.source import line_of, plain, reals, refusal, table

HEADER, TRIANGLE = 84, 50  # bytes of a binary file
RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
FACET, VERTEX = rb"(?i)^[ \t]*facet\b", rb"(?i)^[ \t]*vertex\b[ \t]*(.*)$"
END = rb"(?i)^[ \t]*endsolid\b"
WHOLE = rb"(?i)^[ \t]*endfacet\b"


def read_stl(data: bytes) -> Faces:
    """Return the triangles of an STL file. Raises InputError: cut short, words in place of numbers."""
    promised = int.from_bytes(data[HEADER - 4 : HEADER], "little") if len(data) >= HEADER else -1
    needed = HEADER + TRIANGLE * promised
    if promised >= 0 and len(data) == needed:  # exporters begin binary files with `solid`, too
        return _binary(data, promised, ())
    text = plain(data)
    facets = len(re.findall(FACET, text, re.MULTILINE))
    if facets == 0 and promised > 0 and len(data) > needed:
        return _binary(data, promised, (f"{len(data) - needed} bytes after the last triangle were skipped",))
    if facets == 0 and len(data) >= HEADER and b"\0" in data:
        raise InputError(
            f"{promised} triangles promised, which take {needed} bytes, but there are {len(data)}: damaged or cut short; "
            "export it again"
        )
    lines = re.findall(VERTEX, text, re.MULTILINE)
    parsed = table(lines, 3)
    rows = [line.split()[:3] for line in lines if parsed is None]
    whole = min(len(lines) // 3, len(re.findall(WHOLE, text, re.MULTILINE)))
    if whole != facets or len(lines) != 3 * facets or any(len(row) < 3 for row in rows):
        raise InputError(f"{facets} triangles begin, {whole} are whole: cut short or damaged; export it again")
    if facets and not re.search(END, text, re.MULTILINE):
        raise InputError(f"no `endsolid` follows its {facets} triangles: cut short; export it again")

    def vertex_line(number: int) -> str:
        return line_of(text, VERTEX, number)

    refused = refusal("STL", lambda token: vertex_line(token // 3))
    flat = reals([token for row in rows for token in row], 9 * facets, refused) if parsed is None else parsed[:, :3]
    position, corners = np.ascontiguousarray(flat).reshape(-1, 3), np.arange(3 * facets)
    return Faces(
        position, corners, np.full(facets, 3), vertex_line, lambda number: line_of(text, FACET, number), first=0
    )


def _binary(data: bytes, count: int, notes: tuple[str, ...]) -> Faces:
    records = np.frombuffer(data, RECORD, count, HEADER)
    return uniform(records["corners"].reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), notes)
