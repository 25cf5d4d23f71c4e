"""Selection of vertices of tetrahedral bodies by a word: a side of a body's box, a region of the scene, or all; and the
assignment of pinned ones to motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from softlab.model.base.errors import InputError, SceneError
from softlab.model.base.words import suggestion
from softlab.model.tables.motion import Motion
from softlab.model.tables.regions import SIDES, WORDS, Region

AT_THE_SIDE = 1e-6  # of the longest side: a vertex this near to a side of its box, or to a region, lies in it


def check_word(field: str, word: str, regions: Mapping[str, Region]) -> None:
    """Raise SceneError for a word that is neither a side, `all` nor a region of the scene."""
    if word not in (*WORDS, *regions):
        known = (*WORDS, *regions)
        hint = "" if regions else "; a table of kind region has others"
        raise SceneError(field, word, f"must be one of {', '.join(known)}{suggestion(word, known)}{hint}")


def vertices_of(word: str, local: np.ndarray, here: np.ndarray, regions: Mapping[str, Region]) -> np.ndarray:
    """Return the vertices of a body that `word` selects, (vertices,) int64, ascending.

    `local`, `here`: (particles, 3) [m], positions in its mesh's coordinates and in the scene. Raises SceneError,
    InputError (a region's mesh).
    """
    check_word("pinned", word, regions)
    if word == "all":
        return np.arange(len(local))
    low, high = local.min(axis=0), local.max(axis=0)
    near = AT_THE_SIDE * float((high - low).max())
    if word in regions:
        try:
            return np.flatnonzero(regions[word].holds(here, near))
        except InputError as error:
            raise InputError(f"{word}.{error}") from None
    axis, upper = divmod(SIDES.index(word), 2)
    away = high[axis] - local[:, axis] if upper else local[:, axis] - low[axis]
    return np.flatnonzero(away <= near)


def body_numbers(field: str, body: str | None, names: Sequence[str]) -> list[int]:
    """Return the indices in `names` of the `body`, or of all. Raises SceneError."""
    if body is None:
        return list(range(len(names)))
    if body not in names:
        reason = f"must be one of {', '.join(names)}{suggestion(body, names)}"
        raise SceneError(field, body, reason)
    return [names.index(body)]


def motion_numbers(
    motions: Mapping[str, Motion], pinned: np.ndarray, names: Sequence[str], chosen: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Return the number of each `pinned` vertex's motion (ascending), or -1, (pins,) int64.

    `chosen`: the vertices of each motion, by its name. Raises SceneError for no vertices, for one that is not pinned,
    and for one with another motion.
    """
    numbers, known = np.full(len(pinned), -1, np.int64), list(motions)
    for number, (name, motion) in enumerate(motions.items()):
        vertices, field = chosen[name], f"{name}.pins"
        whose = motion.body or (names[0] if len(names) == 1 else "its body")
        if not len(pinned) or not len(vertices):
            reason = "no vertex lies there" if len(pinned) else f"no vertex is pinned; name some in {whose}.pinned"
            raise SceneError(field, motion.pins, reason)
        loose = vertices[~np.isin(vertices, pinned)]
        if len(loose):
            reason = f"{len(loose)} of these {len(vertices)} vertices are not pinned; name them in {whose}.pinned"
            raise SceneError(field, motion.pins, reason)
        at = np.searchsorted(pinned, vertices)
        taken = np.flatnonzero(numbers[at] >= 0)
        if len(taken):
            other = known[numbers[at[taken[0]]]]
            raise SceneError(
                field, motion.pins, f"vertex {vertices[taken[0]]} already follows {other}; a vertex has one motion"
            )
        numbers[at] = number
    return numbers
