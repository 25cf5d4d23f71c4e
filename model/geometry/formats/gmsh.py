"""Gmsh .msh, versions 2.2 and 4.1, text and binary (the Gmsh reference manual, section 10).

Triangles, quadrilaterals and tetrahedra are taken, of those of second order the corners; other elements are skipped.
"""

from __future__ import annotations

import re

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.formats.elements import Elements
from softlab.model.geometry.formats.source import NotANumber, plain, wholes
from softlab.model.geometry.formats.words import Words

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
        return _text(plain(data).decode("latin-1"), version == "4.1")
    if size != "8":
        raise InputError(f"its numbers have {size} bytes, not 8; export it again")
    one = data[head.end() : head.end() + 4]
    if one not in (b"\1\0\0\0", b"\0\0\0\1"):
        raise InputError("it says that it is binary, and it is not, or it is damaged; export it again")
    order = "<" if one[0] else ">"
    sections = [_after(data, name) for name in (b"$Nodes", b"$Elements")]
    reader = _Binary(data, order)
    return reader.modern(*sections) if version == "4.1" else reader.old(*sections)


def _after(data: bytes, name: bytes) -> int:
    match = re.search(re.escape(name) + rb"[ \t\r]*\n", data)
    if match is None:
        raise InputError(f"it has no {name.decode()}: cut short; export it again")
    return match.end()


def _sorted(name: np.ndarray, position: np.ndarray, blocks: list[tuple[int, np.ndarray]]) -> Elements:
    """Sort the elements in `blocks` of (type, nodes (n, k)) by type."""
    taken = []
    for kinds, corners in ((TRIANGLES, 3), (QUADS, 4), (TETRAHEDRA, 4)):
        rows = [nodes[:, :corners] for kind, nodes in blocks if kind in kinds]
        taken.append(np.concatenate([np.zeros((0, corners), np.int64), *rows]).astype(np.int64))
    return Elements(name, position, *taken)


def _check_kind(kind: int) -> None:
    if kind not in NODES:
        raise InputError(f"its elements of type {kind} are not supported; export triangles or tetrahedra alone")


# ---------------------------------------------------------------------- text


def _text(text: str, modern: bool) -> Elements:
    words = Words(text)
    if not words.upto("$Nodes"):
        raise InputError("it has no $Nodes: cut short; export it again")
    if modern:
        name, position = _node_blocks(words)
    else:
        (count,) = words.counts(1, "nodes")
        rows = words.real(4 * count, "vertices").reshape(count, 4)
        name, position = rows[:, 0].astype(np.int64), rows[:, 1:]
    if not words.upto("$Elements"):
        raise InputError("it has no $Elements: cut short; export it again")
    return _sorted(name, position, _element_blocks(words) if modern else _element_lines(text))


def _node_blocks(words: Words) -> tuple[np.ndarray, np.ndarray]:
    names, places = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    blocks, total, _, _ = words.counts(4, "nodes")
    for _ in range(blocks):
        dimension, _, parametric, count = words.counts(4, "nodes")
        width = 3 + (dimension if parametric else 0)
        names.append(words.whole(count, "nodes"))
        places.append(words.real(count * width, "nodes").reshape(count, width)[:, :3])
    name = np.concatenate(names)
    if len(name) != total:
        raise InputError(f"{total} nodes promised, {len(name)} found: cut short or damaged; export it again")
    return name, np.concatenate(places)


def _element_blocks(words: Words) -> list[tuple[int, np.ndarray]]:
    """Version 4.1: blocks of one type each."""
    elements = []
    blocks, _, _, _ = words.counts(4, "elements")
    for _ in range(blocks):
        _, _, kind, count = words.counts(4, "elements")
        _check_kind(kind)
        width = 1 + NODES[kind]
        elements.append((kind, words.whole(count * width, "elements").reshape(count, width)[:, 1:]))
    return elements


def _element_lines(text: str) -> list[tuple[int, np.ndarray]]:
    """Version 2.2, a line each: number, type, how many tags, tags, nodes."""
    lines = text[text.index("$Elements") :].splitlines()[1:]
    count = int(lines[0]) if lines and lines[0].strip().isdigit() else -1
    rows = [line.split() for line in lines[1 : count + 1]]
    if count < 0 or len(rows) < count or any(len(row) < 4 for row in rows):
        raise InputError(f"{count} elements promised, {len(rows)} lines found: cut short or damaged; export it again")
    elements = []
    try:
        for kind, corners in CORNERS.items():
            taken = [row[3 + int(wholes(row[2:3], 1)[0]) :][:corners] for row in rows if row[1] == str(kind)]
            if any(len(row) < corners for row in taken):
                raise InputError("an element has fewer nodes than its type: cut short or damaged; export it again")
            flat = wholes([word for row in taken for word in row], len(taken) * corners)
            elements.append((kind, flat.reshape(len(taken), corners)))
    except NotANumber as error:
        raise InputError(f"among its elements, {error.message}; export it again") from None
    return elements


# ---------------------------------------------------------------------- binary


class _Binary:
    """A binary file and a place in it; `order`: < or >, of its bytes."""

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

    def whole(self, kind: str, count: int) -> list[int]:
        return [int(number) for number in self.take(kind, count)]

    def line(self) -> int:
        end = self.data.find(b"\n", self.at)
        word = self.data[self.at : end].strip()
        if end < 0 or not word.isdigit():
            raise InputError("a section has no count: cut short or damaged; export it again")
        self.at = end + 1
        return int(word)

    def old(self, nodes: int, elements: int) -> Elements:
        """Read version 2.2."""
        self.at = nodes
        count = self.line()
        rows = self.take("i1", 28 * count).view(np.dtype([("name", self.order + "i4"), ("x", self.order + "f8", 3)]))
        self.at = elements
        left, blocks = self.line(), []
        while left > 0:
            kind, many, tags = self.whole("i4", 3)
            _check_kind(kind)
            if not (0 < many <= left and tags >= 0):
                raise InputError("a block of elements has a wrong length: damaged; export it again")
            width = 1 + tags + NODES[kind]
            blocks.append((kind, self.take("i4", many * width).reshape(many, width)[:, 1 + tags :]))
            left -= many
        return _sorted(rows["name"].astype(np.int64), rows["x"].astype(np.float64), blocks)

    def modern(self, nodes: int, elements: int) -> Elements:
        """Read version 4.1."""
        self.at = nodes
        names, places = [np.zeros(0, np.int64)], [np.zeros((0, 3))]
        for _ in range(self.whole("u8", 4)[0]):
            dimension, _, parametric = self.whole("i4", 3)
            (count,) = self.whole("u8", 1)
            width = 3 + (dimension if parametric else 0)
            names.append(self.take("u8", count).astype(np.int64))
            places.append(self.take("f8", count * width).reshape(count, width)[:, :3].astype(np.float64))
        self.at = elements
        blocks = []
        for _ in range(self.whole("u8", 4)[0]):
            _, _, kind = self.whole("i4", 3)
            (count,) = self.whole("u8", 1)
            _check_kind(kind)
            width = 1 + NODES[kind]
            blocks.append((kind, self.take("u8", count * width).reshape(count, width)[:, 1:].astype(np.int64)))
        return _sorted(np.concatenate(names), np.concatenate(places), blocks)
