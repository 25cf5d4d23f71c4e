"""The scenes that the panel offers: those of the catalogue and the scene files of the working folder, by title."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from softlab.app.window.panes import kind_of_tables
from softlab.model.base.errors import SoftlabError
from softlab.model.scene.reader import catalogue, scene_tables
from softlab.model.tables.bodies import BODY_KINDS
from softlab.model.tables.kinds import SHEETS
from softlab.model.tables.tetrahedra import TETRAHEDRAL_KINDS

MAX_FILES = 200  # of the working folder
WITH_PARTICLES = {
    *SHEETS,
    *BODY_KINDS,
    *TETRAHEDRAL_KINDS,
    "fluid",
}  # kinds of table, of which a scene has one at least


@dataclass(frozen=True)
class Entry:
    """One scene in the list. `name`: argument of `load_scene`; `kind`: of its particles (app/window/panes.py)."""

    name: str
    title: str
    kind: str

    @property
    def label(self) -> str:
        """The title with the name, or the name alone where they are the same."""
        return self.name if self.title == self.name else f"{self.title}  ({self.name})"


@cache
def _entry(name: str, changed: float) -> Entry | None:
    """Return the entry of a scene; None for a file without a scene. `changed`: when the file was written [s], so that
    each version is read once."""
    try:
        tables, known_as = scene_tables(name)
    except SoftlabError:
        return None
    parts = {part: table for part, table in tables.items() if isinstance(table, dict)}
    kinds = {part: str(table.get("kind", part)) for part, table in parts.items()}
    if not WITH_PARTICLES & set(kinds.values()):
        return None
    axes = [table.get("dimensions", 3) for part, table in parts.items() if kinds[part] == "fluid"]
    return Entry(name, str(tables.get("title", known_as)), kind_of_tables(kinds, *axes[:1]))


def scene_entries(folder: Path | None = None) -> list[Entry]:
    """Return the scenes of the folder (the working folder by default), then the catalogue, its hard cases last; by
    name."""
    files = sorted((folder or Path.cwd()).glob("*.toml"))[:MAX_FILES]
    local = [_entry(str(file) if folder else file.name, file.stat().st_mtime) for file in files]
    names = sorted(catalogue(), key=lambda name: ("/" in name, name))
    return [entry for entry in (*local, *(_entry(name, 0.0) for name in names)) if entry is not None]


def matching(entries: Sequence[Entry], text: str) -> list[Entry]:
    """Return the entries whose title or name contains every word of `text`, ignoring case."""
    words = text.lower().split()
    return [entry for entry in entries if all(word in entry.label.lower() for word in words)]
