"""Gmsh .msh, versions 2.2 and 4.1, text and binary (the Gmsh reference manual, section 10).

Triangles, quadrilaterals and tetrahedra are taken, of those of second order the corners; other elements are skipped.
"""

from __future__ import annotations

import re

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.formats.elements import Elements
from softlab.model.geometry.formats.source import plain, wholes
from softlab.model.geometry.formats.words import Words, refusal_among

NODES = {
    1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5, 8: 3, 9: 6, 10: 9, 11: 10, 12: 27, 13: 18, 14: 14, 15: 1, 16: 8, 17: 20,
}  # fmt: skip
CORNERS = {2: 3, 9: 3, 3: 4, 10: 4, 16: 4, 4: 4, 11: 4}  # of the types that are taken
TRIANGLES, QUADS, TETRAHEDRA = (2, 9), (3, 10, 16), (4, 11)
VERSIONS = ("2", "2.2", "4.1")


def read_gmsh(data: bytes) -> Elements:
    """Return the elements of a .msh file. Raises InputError: another version, cut short, words for numbers."""
    head = re.search(rb"\$MeshFormat\s+(\S+)\s+(\S+)\s+(\S+)[ \t\r]*\n?", data)
    if head is None:
        raise InputError("it has no $MeshFormat; export it from gmsh as version 2.2 or 4.1")
    version, kind, size = (word.decode("latin-1") for word in head.groups())
    if version not in VERSIONS:
        raise InputError(f"it is of version {version[:20]}; export it as 2.2 or 4.1 (in gmsh: Mesh.MshFileVersion)")
    if kind == "0":
        text = plain(data).decode("latin-1")
        return _blocks(_Text(text)) if version == "4.1" else _lines(text)
    if size != "8":
        raise InputError(f"its numbers have {size} bytes, not 8; export it again")
    one = data[head.end() : head.end() + 4]
    if one not in (b"\1\0\0\0", b"\0\0\0\1"):
        raise InputError("it is declared as binary, but is not, or is damaged; export it again")
    reader = _Binary(data, "<" if one[0] else ">")
    return _blocks(reader) if version == "4.1" else reader.lines()


def _sorted(name: np.ndarray, position: np.ndarray, blocks: list[tuple[int, np.ndarray]]) -> Elements:
    """`blocks`: (type, nodes (n, k)) of elements."""
    taken = []
    for kinds, corners in ((TRIANGLES, 3), (QUADS, 4), (TETRAHEDRA, 4)):
        rows = [nodes[:, :corners] for kind, nodes in blocks if kind in kinds]
        taken.append(np.concatenate([np.zeros((0, corners), np.int64), *rows]).astype(np.int64))
    return Elements(name, position, *taken)


def _check_kind(kind: int) -> None:
    if kind not in NODES:
        raise InputError(f"its elements of type {kind} are not supported; export triangles or tetrahedra alone")


# ---------------------------------------------------------------------- version 4.1


def _blocks(source: _Text | _Binary) -> Elements:
    """Version 4.1: blocks of nodes, and of elements of one type each."""
    source.section("$Nodes")
    names, places = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    blocks, total, _, _ = source.sizes(4, "nodes")
    for _ in range(blocks):
        dimension, _, parametric = source.ints(3, "nodes")
        (count,) = source.sizes(1, "nodes")
        width = 3 + (dimension if parametric else 0)
        names.append(source.tags(count, "nodes"))
        places.append(source.real(count * width, "nodes").reshape(count, width)[:, :3])
    name = np.concatenate(names)
    if len(name) != total:
        raise InputError(f"{total} nodes promised, {len(name)} found: cut short or damaged; export it again")
    source.section("$Elements")
    elements = []
    for _ in range(source.sizes(4, "elements")[0]):
        _, _, kind = source.ints(3, "elements")
        (count,) = source.sizes(1, "elements")
        _check_kind(kind)
        width = 1 + NODES[kind]
        elements.append((kind, source.tags(count * width, "elements").reshape(count, width)[:, 1:]))
    return _sorted(name, np.concatenate(places), elements)


# ---------------------------------------------------------------------- text


class _Text(Words):
    """The words of a text; integers of every size are written alike."""

    def section(self, name: str) -> None:
        """Go behind the line `name`. Raises InputError."""
        if not self.upto(name):
            raise InputError(f"it has no {name}: cut short; export it again")

    ints = sizes = Words.counts
    tags = Words.whole


def _lines(text: str) -> Elements:
    """Read version 2.2."""
    words = _Text(text)
    words.section("$Nodes")
    (count,) = words.counts(1, "nodes")
    rows = words.real(4 * count, "vertices").reshape(count, 4)
    words.section("$Elements")
    return _sorted(rows[:, 0].astype(np.int64), rows[:, 1:], _element_lines(text))


def _element_lines(text: str) -> list[tuple[int, np.ndarray]]:
    """Return (type, nodes) of the lines of version 2.2: number, type, how many tags, tags, nodes."""
    lines = text[text.index("$Elements") :].splitlines()[1:]
    count = int(lines[0]) if lines and lines[0].strip().isdigit() else -1
    rows = [line.split() for line in lines[1 : count + 1]]
    if count < 0 or len(rows) < count or any(len(row) < 4 for row in rows):
        raise InputError(f"{count} elements promised, {len(rows)} lines found: cut short or damaged; export it again")
    elements, refused = [], refusal_among("elements")
    for kind, corners in CORNERS.items():
        taken = [row[3 + int(wholes(row[2:3], 1, refused)[0]) :][:corners] for row in rows if row[1] == str(kind)]
        if any(len(row) < corners for row in taken):
            raise InputError("an element has fewer nodes than its type: cut short or damaged; export it again")
        flat = wholes([word for row in taken for word in row], len(taken) * corners, refused)
        elements.append((kind, flat.reshape(len(taken), corners)))
    return elements


# ---------------------------------------------------------------------- binary


class _Binary:
    """A binary file and a position in it; `order`: < or >, its byte order."""

    def __init__(self, data: bytes, order: str):
        self.data, self.order, self.at = data, order, 0

    def take(self, kind: str, count: int) -> np.ndarray:
        size = np.dtype(kind).itemsize * count
        if count < 0 or self.at + size > len(self.data):
            raise InputError(
                f"{count} numbers promised, {(len(self.data) - self.at) // np.dtype(kind).itemsize} left: cut short or "
                "damaged; export it again"
            )
        self.at += size
        return np.frombuffer(self.data, self.order + kind, count, self.at - size)

    def section(self, name: str) -> None:
        """Go behind the line `name`. Raises InputError."""
        match = re.search(re.escape(name).encode() + rb"[ \t\r]*\n", self.data)
        if match is None:
            raise InputError(f"it has no {name}: cut short; export it again")
        self.at = match.end()

    def ints(self, count: int, _what: str) -> list[int]:
        return self.take("i4", count).tolist()

    def sizes(self, count: int, _what: str) -> list[int]:
        return self.take("u8", count).tolist()

    def tags(self, count: int, _what: str) -> np.ndarray:
        return self.take("u8", count).astype(np.int64)

    def real(self, count: int, _what: str) -> np.ndarray:
        return self.take("f8", count).astype(np.float64)

    def line(self) -> int:
        end = self.data.find(b"\n", self.at)
        word = self.data[self.at : end].strip()
        if end < 0 or not word.isdigit():
            raise InputError("a section has no count: cut short or damaged; export it again")
        self.at = end + 1
        return int(word)

    def lines(self) -> Elements:
        """Read version 2.2."""
        self.section("$Nodes")
        rows = self.take("i1", 28 * self.line()).view(
            np.dtype([("name", self.order + "i4"), ("x", self.order + "f8", 3)])
        )
        self.section("$Elements")
        left, blocks = self.line(), []
        while left > 0:
            kind, many, tags = self.ints(3, "elements")
            _check_kind(kind)
            if not (0 < many <= left and tags >= 0):
                raise InputError("a block of elements has a wrong length: damaged; export it again")
            width = 1 + tags + NODES[kind]
            blocks.append((kind, self.take("i4", many * width).reshape(many, width)[:, 1 + tags :]))
            left -= many
        return _sorted(rows["name"].astype(np.int64), rows["x"].astype(np.float64), blocks)
