"""PLY (G. Turk, 1994), text and binary in either byte order: vertices, faces of any size, triangle strips.

Other elements and properties are skipped.
"""

from __future__ import annotations

import re

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.base.waiting import steps
from softlab.model.geometry.formats.faces import Faces
from softlab.model.geometry.formats.ply_header import Element, coordinates, header_of, list_of, refused
from softlab.model.geometry.formats.source import READING, plain, polygon_table, reals, refusal, row_of, table, wholes

_Lists = tuple[str, np.ndarray, np.ndarray]  # name of an element, vertices of its lists (sum of sizes,), sizes (rows,)


def read_ply(data: bytes) -> Faces:
    """Return the faces of a PLY file. Raises InputError: no header, cut short, no coordinates."""
    head = data[: 1 << 20]
    if b"\n" not in head.split(b"end_header")[0]:  # line ends of old Macs
        end = re.search(rb"\rend_header[ \t]*\r", head)
    else:
        end = re.search(rb"\nend_header[ \t]*(?:\r\n|\n)", head)
    if not data.startswith(b"ply") or end is None:
        raise refused("it has no header from `ply` to `end_header`")
    lines = plain(data[: end.end()]).decode("latin-1").splitlines()
    form, elements = header_of(lines)
    if form == "ascii":
        return _text(plain(data[end.end() :]), elements, len(lines))
    return _binary(data[end.end() :], elements, "<" if form == "binary_little_endian" else ">")


# ---------------------------------------------------------------------- text


def _text(body: bytes, elements: list[Element], header: int) -> Faces:
    """Every row is a line; empty lines are skipped."""
    lines = body.split(b"\n")
    filled = [number for number, line in enumerate(lines) if line.strip()]
    position, parts, at, first_vertex, first_face = np.zeros((0, 3)), [], 0, 0, 0
    for element in elements:
        numbers = filled[at : at + element.length]
        if element.name == "vertex":
            if len(numbers) < element.length:
                raise InputError(
                    f"{element.length} vertices promised, {len(numbers)} found: it is cut short; export it again"
                )
            position, first_vertex = _text_vertices(element, lines, numbers, header), at
        elif element.name in ("face", "tristrips"):
            parts.append(_text_lists(element, lines, numbers, header))
            first_face = at if element.name == "face" else first_face
        at += element.length

    def line(first: int, number: int) -> str:
        return f"line {header + filled[first + number] + 1}" if first + number < len(filled) else ""

    corners, sizes = _gathered(parts)
    return Faces(
        position, corners, sizes, lambda number: line(first_vertex, number), lambda number: line(first_face, number)
    )


def _text_vertices(element: Element, lines: list[bytes], numbers: list[int], header: int) -> np.ndarray:
    places = coordinates(element)
    wanted = len(element.properties)
    parsed = table([lines[number] for number in numbers], wanted)
    if parsed is not None:
        return np.ascontiguousarray(parsed[:, places])
    rows = [lines[number].split() for number in numbers]
    for number, row in zip(numbers, rows, strict=True):
        if len(row) < wanted:
            raise InputError(
                f"line {header + number + 1} has {len(row)} numbers of {wanted} of a vertex: damaged or cut short; export "
                "it again"
            )
    at_line = refusal("PLY", lambda token: f"line {header + numbers[token // 3] + 1}")
    return reals([row[place] for row in rows for place in places], 3 * len(rows), at_line).reshape(-1, 3)


def _text_lists(element: Element, lines: list[bytes], numbers: list[int], header: int) -> _Lists:
    """Return the lists of vertices of an element's rows."""
    place = list_of(element)
    if place == 0 and len(numbers) == element.length:
        same = polygon_table([lines[number] for number in numbers])
        if same is not None:
            return element.name, same.ravel(), np.full(len(same), same.shape[1], np.int64)
    polygons: list[list[bytes]] = []
    for number in steps(numbers, len(numbers), READING):
        words, at = lines[number].split(), 0
        for which, one in enumerate(element.properties):
            length = 1
            if one.count:
                count = words[at] if at < len(words) else b""
                length = int(count) if count.isdigit() else len(words) + 1
                at += 1
            if which == place:
                if at + length > len(words):
                    raise InputError(_short(element, len(polygons)) + f" (line {header + number + 1})")
                polygons.append(words[at : at + length])
                break
            at += length
    if len(polygons) < element.length:
        raise InputError(_short(element, len(polygons)))
    sizes = np.fromiter(map(len, polygons), np.int64, len(polygons))
    at_line = refusal("PLY", lambda token: f"line {header + numbers[row_of(token, sizes)] + 1}")
    return element.name, wholes([word for row in polygons for word in row], int(sizes.sum()), at_line), sizes


def _short(element: Element, readable: int) -> str:
    return (
        f"{element.length} faces, of which {readable} can be read: it is cut short, or has faces of fewer than three "
        "corners; export it again"
    )


# ---------------------------------------------------------------------- binary


def _binary(body: bytes, elements: list[Element], order: str) -> Faces:
    position, parts, at = np.zeros((0, 3)), [], 0
    for element in elements:
        if element.name == "vertex" or not any(one.count for one in element.properties):
            columns = coordinates(element) if element.name == "vertex" else []
            row = np.dtype([(f"p{k}", order + one.kind) for k, one in enumerate(element.properties)])
            _check_rest(element, body, at, row.itemsize * element.length)
            if element.name == "vertex":
                rows = np.frombuffer(body, row, element.length, at)
                position = np.stack([rows[f"p{k}"].astype(np.float64) for k in columns], axis=1)
            at += row.itemsize * element.length
            continue
        lists, at = _binary_lists(element, body, at, order)
        if element.name in ("face", "tristrips"):
            parts.append(lists)
    corners, sizes = _gathered(parts)
    return Faces(position, corners, sizes)


def _check_rest(element: Element, body: bytes, at: int, needed: int) -> None:
    if at + needed > len(body):
        raise InputError(
            f"it cannot be read as PLY: {element.length} rows of `{element.name}` take {needed} bytes, and {len(body) - at} "
            "are left: cut short or damaged; export it again"
        )


def _binary_lists(element: Element, body: bytes, at: int, order: str) -> tuple[_Lists, int]:
    """Return (lists of vertices of the element's rows, where the next element begins). Rows of one length at once."""
    wanted = list_of(element)
    if element.length:
        row = _row_like_the_first(element, body, at, order)
        if row is not None and at + row.itemsize * element.length <= len(body):
            rows = np.frombuffer(body, row, element.length, at)
            counts = [name for name in row.names or () if name.startswith("n")]
            if all((rows[name] == rows[name][0]).all() for name in counts):
                same = rows[f"p{wanted}"].astype(np.int64)
                sizes = np.full(len(same), same.shape[1], np.int64)
                return (element.name, same.ravel(), sizes), at + row.itemsize * element.length
    polygons = []
    kinds = [
        (np.dtype(order + one.kind), np.dtype(order + one.count) if one.count else None) for one in element.properties
    ]
    for _ in steps(range(element.length), element.length, READING):
        for k, (kind, count) in enumerate(kinds):
            length = 1
            if count is not None:
                _check_rest(element, body, at, count.itemsize)
                length = int(np.frombuffer(body, count, 1, at)[0])
                at += count.itemsize
            if length < 0:
                raise refused("a list has a negative length: damaged")
            _check_rest(element, body, at, kind.itemsize * length)
            if k == wanted:
                polygons.append(np.frombuffer(body, kind, length, at).astype(np.int64))
            at += kind.itemsize * length
    sizes = np.fromiter(map(len, polygons), np.int64, len(polygons))
    return (element.name, np.concatenate([np.zeros(0, np.int64), *polygons]), sizes), at


def _row_like_the_first(element: Element, body: bytes, at: int, order: str) -> np.dtype | None:
    fields: list[tuple] = []
    for k, one in enumerate(element.properties):
        if not one.count:
            fields.append((f"p{k}", order + one.kind))
            at += np.dtype(one.kind).itemsize
            continue
        count = np.dtype(order + one.count)
        if at + count.itemsize > len(body):
            return None
        length = int(np.frombuffer(body, count, 1, at)[0])
        if not 0 <= length <= len(body):
            return None
        fields += [(f"n{k}", count), (f"p{k}", order + one.kind, (length,))]
        at += count.itemsize + length * np.dtype(one.kind).itemsize
    return np.dtype(fields)


def _gathered(parts: list[_Lists]) -> tuple[np.ndarray, np.ndarray]:
    """Return (corners, sizes) of faces and of strips, which -1 separates."""
    corners, sizes = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for name, flat, lengths in parts:
        if name == "tristrips":
            strips = np.split(flat, np.cumsum(lengths)[:-1])
            triangles = [triangle for strip in strips for triangle in _strip(strip)]
            flat, lengths = np.concatenate([np.zeros(0, np.int64), *triangles]), np.full(len(triangles), 3)
        corners.append(flat)
        sizes.append(lengths)
    size = np.concatenate(sizes)
    if len(size) and size.min() < 3:
        raise InputError(
            f"{len(size)} faces, of which {int((size > 2).sum())} can be read: it has faces of fewer than three corners; "
            "export it again"
        )
    return np.concatenate(corners), size


def _strip(strip: np.ndarray) -> list[np.ndarray]:
    """Return the triangles of strips of vertices; every second one is reversed."""
    triangles = []
    for run in np.split(strip, np.flatnonzero(strip < 0)):
        run = run[run >= 0]
        for k in range(len(run) - 2):
            triangles.append(run[[k, k + 1, k + 2]] if k % 2 == 0 else run[[k + 1, k, k + 2]])
    return triangles
