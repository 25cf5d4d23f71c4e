"""Names that a user picks from a list: `--integrator`, `--precision`, `--case`."""

from __future__ import annotations

from collections.abc import Sequence

from model.core.errors import SceneError


def chosen(names: Sequence[str] | None, known: Sequence[str], what: str, rows: bool = False) -> list[str]:
    """`names` (None: all), each one of `known`, or with `rows` the row that several begin with. Raises SceneError."""
    if not names:
        return list(known)
    found = []
    for name in names:
        mine = [k for k in known if k.lower() == name.lower() or (rows and k.split()[0].lower() == name.lower())]
        if not mine:
            raise SceneError(what, name, f"must be one of {', '.join(known)}")
        found += mine
    return list(dict.fromkeys(found))
