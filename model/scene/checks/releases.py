"""The tables of a scene after some of its pins were released: without those pins, their motions and attachments."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.base.pins import PIN_WORDS, pin_indices
from softlab.model.base.table import Table
from softlab.model.base.words import suggestion
from softlab.model.scene.scene_parts import SceneParts
from softlab.model.tables.attachment import Attachment
from softlab.model.tables.attachment import pins as is_pinning
from softlab.model.tables.kinds import SHEETS
from softlab.model.tables.mesh import Mesh
from softlab.model.tables.motion import ALL, RELEASE, Release, masses_of
from softlab.model.tables.parts import Grid
from softlab.model.tables.tetrahedra import TETRAHEDRAL_KINDS


def check_releases(scene: SceneParts) -> None:
    """Raise SceneError for a release in a scene in which nothing can be pinned."""
    if not scene.all_of(*SHEETS, *TETRAHEDRAL_KINDS):
        reason = "needs pins, which a grid, a cloth, a mesh and a tetrahedral_body have; this scene has none of them"
        scene.refuse((RELEASE,), reason)


def tables_without(scene: SceneParts, names: Iterable[str]) -> dict[str, Table]:
    """Return the scene's tables after the releases `names` have happened, without tables of releases. Raises SceneError
    for a release that unpins nothing."""
    tables = scene.as_dict()
    for name in names:
        _let_go(scene, tables, name)
    return {name: table for name, table in tables.items() if scene.kinds.get(name) != RELEASE}


def _let_go(scene: SceneParts, tables: dict[str, Table], name: str) -> None:
    """Remove the pins of the release `name` from the `tables`."""
    release = scene.parts_of(Release)[name]
    holders = scene.all_of(*SHEETS, *TETRAHEDRAL_KINDS)
    if release.body not in (None, *holders):
        known = f"must be one of {', '.join(holders)}{suggestion(str(release.body), holders)}"
        raise SceneError(f"{name}.body", release.body, known)
    chosen = holders if release.body is None else {release.body: holders[release.body]}
    freed = False
    for holder, part in chosen.items():
        table = tables[holder]
        freed |= _free_masses(table, part, release, name) if isinstance(part, Grid) else _free_words(table, release)
    freed |= _free_attachments(scene, tables, release)
    if not freed:
        reason = f"names no pin of {', '.join(chosen)} that is held until then; name those of `pinned`"
        raise SceneError(f"{name}.pins", release.pins, reason)
    _end_motions(scene, tables, release)


def _free_words(table: Table, release: Release) -> bool:
    """Unpin vertices of the tetrahedral body of this `table`; its other words stay. Returns True if there were any."""
    before = table["pinned"]
    table["pinned"] = [word for word in before if release.pins not in (ALL, word)]
    return len(table["pinned"]) < len(before)


def _free_masses(table: Table, part: Grid, release: Release, name: str) -> bool:
    """Unpin masses of the sheet of this `table`; the others become a list. Returns True if there were any."""
    before = table["pinned"]
    if release.pins in (ALL, before):
        table["pinned"] = "none"
        return before not in ("none", [])
    if isinstance(part, Mesh) and part.file is not None:
        if not (isinstance(before, list) and isinstance(release.pins, list)):
            return False
        table["pinned"] = [vertex for vertex in before if vertex not in release.pins] or "none"
        return table["pinned"] != before
    if not _is_of_a_sheet(release.pins):
        return False
    pinned = pin_indices(before, part.rows, part.columns)
    left = np.setdiff1d(pinned, masses_of(release.pins, part, f"{name}.pins"))
    table["pinned"] = _listed(left, part.columns)
    return len(left) < len(pinned)


def _is_of_a_sheet(pins: str | list[int] | list[tuple[int, int]]) -> bool:
    """True for masses of rows and columns, false for the name of a region or an attachment."""
    if isinstance(pins, str):
        return pins in PIN_WORDS or pins.startswith("every:")
    return not isinstance(pins[0], int)


def _listed(masses: np.ndarray, columns: int) -> list[list[int]] | str:
    """Return masses in the form of a sheet's `pinned`."""
    return [list(divmod(int(one), columns)) for one in masses] or "none"


def _free_attachments(scene: SceneParts, tables: dict[str, Table], release: Release) -> bool:
    """Remove the attachment that `release.pins` names, or (`all`) those that pin the body. Returns True if there were
    any."""
    bodies = list(scene.all_of("mesh", *TETRAHEDRAL_KINDS))
    ended = [
        name
        for name, part in scene.parts_of(Attachment).items()
        if name in tables
        and release.body in (None, part.body)
        and (release.pins == name or (release.pins == ALL and is_pinning(part, bodies)))
    ]
    for name in ended:
        del tables[name]
    return bool(ended)


def _end_motions(scene: SceneParts, tables: dict[str, Table], release: Release) -> None:
    """Remove the motions of released pins; masses of a sheet that are still pinned keep theirs."""
    bodies = scene.all_of("mesh", *TETRAHEDRAL_KINDS) if scene.all_of(*TETRAHEDRAL_KINDS) else {}
    for motion in [one for one in scene.all_of("motion") if one in tables]:
        table = tables[motion]
        if bodies:
            whose = [table["body"]] if table.get("body") else list(bodies)
            words = {str(word) for body in whose for word in _words(tables, scene, body)}
            over = (
                not words
                if table["pins"] == ALL
                else table["pins"] not in words and release.pins in (ALL, table["pins"])
            )
            if over and (release.body is None or release.body in whose):
                del tables[motion]
            continue
        ((holder, part),) = scene.parts_of(Grid).items()
        moved = masses_of(table["pins"], part, f"{motion}.pins")
        left = np.intersect1d(moved, pin_indices(tables[holder]["pinned"], part.rows, part.columns))
        if not len(left):
            del tables[motion]
        elif len(left) < len(moved):
            table["pins"] = _listed(left, part.columns)


def _words(tables: dict[str, Table], scene: SceneParts, body: str) -> list[str]:
    """Return the words that still pin vertices of a body: those of its `pinned`, of attachments, and `its pins` of a
    cloth."""
    pinned = tables[body]["pinned"] if body in tables else []
    words = [] if pinned in ("none", []) else ["its pins"] if isinstance(pinned, str) else [str(one) for one in pinned]
    attached = [
        part.vertices for name, part in scene.parts_of(Attachment).items() if name in tables and part.body == body
    ]
    return words + attached
