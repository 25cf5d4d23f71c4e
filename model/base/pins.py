"""Pinned masses of a sheet: named by a word, or a list of [row, column]."""

from __future__ import annotations

import re

import numpy as np

from softlab.model.base.words import suggestion

PIN_WORDS = ("none", "top", "bottom", "left", "right", "top-bottom", "left-right", "top-corners", "edges")
PIN_RULE = f"{', '.join(PIN_WORDS)}, every:K (of the top row, K >= 1) or a list [[row, column], ...]"

Pins = str | list[tuple[int, int]]  # of a sheet of rows and columns
MeshPins = Pins | list[int]  # of any sheet: vertices of a mesh, too


def checked_pins(value: object) -> Pins:
    """Return `value` as Pins. Raises ValueError for values that are neither a word nor a list of pairs of integers."""
    if isinstance(value, str):
        if value not in PIN_WORDS and not re.fullmatch(r"every:([1-9][0-9]{0,9})", value):
            raise ValueError(f"must be one of {PIN_RULE}{suggestion(value, PIN_WORDS)}")
        return value
    if not isinstance(value, list | tuple):
        raise ValueError(f"must be one of {PIN_RULE}")
    for pair in value:
        if (
            not isinstance(pair, list | tuple)
            or len(pair) != 2
            or not all(isinstance(k, int) and not isinstance(k, bool) for k in pair)
        ):
            raise ValueError(f"must be one of {PIN_RULE}")
    return [(pair[0], pair[1]) for pair in value]


def pin_indices(pins: MeshPins, rows: int, columns: int) -> np.ndarray:
    """Return the sorted flat indices (row * columns + column), int64, of the masses of a sheet that `pins` names: a
    word, masses [row, column], or indices."""
    if isinstance(pins, list):
        places = np.array(pins, dtype=np.int64)
        return np.unique(places if places.ndim == 1 else places[:, 0] * columns + places[:, 1])
    if pins.startswith("every:"):
        return np.arange(0, columns, int(pins.removeprefix("every:")), dtype=np.int64)
    across, down = np.arange(columns, dtype=np.int64), np.arange(rows, dtype=np.int64) * columns
    sides = {"top": across, "bottom": across + (rows - 1) * columns, "left": down, "right": down + columns - 1}
    named = {
        "none": [],
        "top-corners": [across[[0, -1]]],
        "edges": list(sides.values()),
        **{side: [masses] for side, masses in sides.items()},
    }
    chosen = named.get(pins) if pins in named else [sides[side] for side in pins.split("-")]
    return np.unique(np.concatenate([np.zeros(0, np.int64), *(chosen or [])]))
