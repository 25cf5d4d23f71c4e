"""The header of a PLY file: its elements with their numbers of rows and their properties."""

from __future__ import annotations

from dataclasses import dataclass, field

from softlab.model.base.errors import InputError

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8",
    "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
LISTS = ("vertex_indices", "vertex_index")


@dataclass
class Property:
    """A column of an element: numbers of one type, or lists of them."""

    name: str
    kind: str
    count: str = ""  # type of a list's length; empty: one number


@dataclass
class Element:
    """A table of `length` rows with the columns `properties`."""

    name: str
    length: int
    properties: list[Property] = field(default_factory=list)

    def at(self, names: tuple[str, ...]) -> list[int]:
        """Return the places of the properties of these names, in the order of `names`."""
        known = {one.name.lower(): place for place, one in enumerate(self.properties)}
        return [known[name] for name in names if name in known]


def refused(reason: str) -> InputError:
    """Return the error for a file that is not PLY, with the reason."""
    return InputError(f"it cannot be read as PLY: {reason}; export it again")


def header_of(lines: list[str]) -> tuple[str, list[Element]]:
    """Return (format, elements in the order of the file). Raises InputError, with the line."""
    form, elements = "", list[Element]()
    for number, line in enumerate(lines, 1):
        words = line.split()
        try:
            if words[:1] == ["format"]:
                form = words[1]
            elif words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2])))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append(Property(words[4], TYPES[words[3]], TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(Property(words[2], TYPES[words[1]]))
        except (IndexError, KeyError, ValueError):
            raise refused(f"line {number} is no line of a header") from None
    if form not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise refused(f"its format is {form or 'not given'}")
    if any(element.length < 0 for element in elements):
        raise refused("an element has a negative length")
    return form, elements


def coordinates(element: Element) -> list[int]:
    """Return the places of x, y and z among the properties of vertices. Raises InputError."""
    if any(one.count for one in element.properties):
        raise InputError("it cannot be read as PLY: its vertices hold lists; export it without them")
    places = element.at(("x", "y", "z"))
    if len(places) < 3:
        raise refused("its vertices have no x, y and z")
    return places


def list_of(element: Element) -> int:
    """Return the index of the list of vertices among the properties of faces, -1 if there is none. Raises
    InputError."""
    place = next((k for k, one in enumerate(element.properties) if one.count and one.name in LISTS), None)
    if place is None:
        place = next((k for k, one in enumerate(element.properties) if one.count), None)
    if place is None and element.length:
        raise refused("its faces have no list of vertices")
    return -1 if place is None else place
