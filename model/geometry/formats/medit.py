"""Medit .mesh, text: vertices, triangles, quadrilaterals, tetrahedra (P. Frey, INRIA RT-0253 (2001)). Others are skipped."""

from __future__ import annotations

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.formats.elements import Elements
from softlab.model.geometry.formats.source import plain, without_comments
from softlab.model.geometry.formats.words import Words

CORNERS = {"Triangles": 3, "Quadrilaterals": 4, "Tetrahedra": 4}


def read_medit(data: bytes) -> Elements:
    """Return the elements of a Medit file. Raises InputError: another kind of .mesh, cut short, words for numbers."""
    words = Words(without_comments(plain(data)).decode("latin-1"))
    if not words.words or not words.words[0].startswith("MeshVersionFormatted"):
        raise InputError(
            "it is no Medit file, which begins with MeshVersionFormatted (other programs write other .mesh files); export it "
            "as .obj or .ply"
        )
    dimension = words.counts(1, "dimensions")[0] if words.upto("Dimension") else 3
    if dimension not in (2, 3):
        raise InputError(f"its dimension is {dimension}; must be 2 or 3")
    words.at = 0
    if not words.upto("Vertices"):
        raise InputError("it has no Vertices: cut short; export it again")
    (count,) = words.counts(1, "vertices")
    rows = words.real(count * (dimension + 1), "vertices").reshape(count, dimension + 1)
    position = np.zeros((count, 3))
    position[:, :dimension] = rows[:, :dimension]
    elements = {}
    for keyword, corners in CORNERS.items():
        words.at = 0
        many = words.counts(1, keyword)[0] if words.upto(keyword) else 0
        elements[keyword] = words.whole(many * (corners + 1), keyword).reshape(many, corners + 1)[:, :corners]
    return Elements(
        np.arange(1, count + 1), position, elements["Triangles"], elements["Quadrilaterals"], elements["Tetrahedra"]
    )
