"""Sources of scenes: the catalogue, files, settings of a command line. They are returned as tables, from which
model/scene/scene.py makes objects."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib import resources
from pathlib import Path

from softlab.model.base.errors import InputError, SceneError, shown
from softlab.model.base.files import is_there, read_text
from softlab.model.base.table import Table, Tables
from softlab.model.base.words import suggestion
from softlab.model.geometry.mesh_files import FORMATS
from softlab.model.geometry.topology import bundled_meshes, is_file
from softlab.model.scene.toml_errors import plain_error
from softlab.model.tables.bodies import BODY_KINDS
from softlab.model.tables.cloth import SURFACE_KINDS
from softlab.model.tables.tetrahedra import TETRAHEDRAL_KINDS

TOO_LONG = re.compile(r"[0-9_]{1000,}")  # digits of an integer that Python may refuse to read
OF_MESHES = ("mesh", "region", *SURFACE_KINDS, *BODY_KINDS, *TETRAHEDRAL_KINDS)  # kinds of parts that may name a file


@cache
def catalogue() -> Mapping[str, Path]:
    """Return the scenes that come with softlab: name -> TOML file."""
    root = Path(str(resources.files("softlab.model"))) / "catalogue"
    return {file.relative_to(root).with_suffix("").as_posix(): file for file in sorted(root.rglob("*.toml"))}


def scene_tables(name_or_path: str | Path) -> tuple[Table, str]:
    """Return (tables, name) of a catalogue name (`lab-grid`) or of a TOML file, with the paths of its meshes (see
    `with_meshes`).

    Raises InputError (no such name, unreadable, not TOML, no such mesh).
    """
    text = str(name_or_path)
    known = catalogue()
    if text in ("", "."):
        raise InputError(
            f"{text!r} is a directory or nothing; a scene is one of those that `softlab scenes` lists, or a .toml file"
        )
    path = known.get(text)
    if path is None:
        path = Path(text)
        folders = {name.split("/")[0] for name in known if "/" in name}
        inside = len(path.parts) <= 1 or path.parts[0] in folders
        is_name = path.suffix == "" and inside and not is_there(path)
        if is_name:
            raise InputError(
                f"unknown scene {shown(text)}{suggestion(text, known)}; `softlab scenes` lists those that come with the lab, "
                "or give a .toml file"
            )
    written = read_text(path, "a scene is a .toml file; `softlab scenes` lists those that come with the lab")
    try:
        data = tables_of(written)
    except ValueError as error:
        reason = plain_error(written, error) if isinstance(error, tomllib.TOMLDecodeError) else error
        mesh = (
            f"; to use a mesh as a cloth, write a scene file with [mesh] file = {Path(text).name!r}"
            if Path(text).suffix in FORMATS
            else ""
        )
        raise InputError(f"{text} is not TOML: {reason}{mesh}") from None
    return with_meshes(data, path.parent), text if text in known else path.stem


def with_meshes(tables: Tables, folder: Path) -> Table:
    """Return the tables of a scene in `folder`, with absolute paths of its meshes.

    So the scene can be read from anywhere when it is written elsewhere (a store, a trajectory, another scene file). A
    file is searched beside the scene, then among the lab's own, which keep their name, then from the current folder.
    Raises InputError, with the places searched.
    """
    resolved = dict(tables)
    for name, table in tables.items():
        if not isinstance(table, Mapping) or table.get("kind", name) not in OF_MESHES:
            continue
        file = table.get("file")
        if isinstance(file, str):
            resolved[name] = {**table, "file": _resolved(f"{name}.file", file, folder)}
    return resolved


def _resolved(field: str, file: str, folder: Path) -> str:
    beside, here, bundled = (folder / file).absolute(), Path(file).absolute(), bundled_meshes()
    if is_file(beside):
        return str(beside)
    if file in bundled:
        return file
    if is_file(here):
        return str(here)
    places = f"neither {beside} (beside the scene) nor {here} (from the current folder)"
    if beside == here:
        places = f"looked for {here}"
    raise InputError(f"{field} = {file}: no such file: {places}; the lab's own meshes: {', '.join(bundled)}")


def tables_of(text: str) -> Table:
    """Return the tables of a TOML text.

    Raises ValueError, with the fault and its place: tomllib.TOMLDecodeError, or a value that TOML allows and Python
    cannot read.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except (RecursionError, MemoryError):
        raise ValueError("values nested too deep; a scene has lists of lists, no more") from None
    except ValueError:  # from int(), the one error that tomllib does not convert
        long = TOO_LONG.search(text)
        place = f" (at line {text.count(chr(10), 0, long.start()) + 1})" if long else ""
        raise ValueError(f"a whole number of thousands of digits{place}; give a shorter one") from None


def parse_value(text: str) -> object:
    """Return the value of `--set key=value`: read as TOML (numbers, true, lists), else as a plain word."""
    try:
        parsed = tables_of(f"value = {text}")
        return parsed["value"] if set(parsed) == {"value"} else text
    except tomllib.TOMLDecodeError:
        return text


def parse_settings(settings: list[str] | None) -> dict[str, object]:
    """Return `["grid.rows=64", ...]` as {path: value}. Raises SceneError where the equals sign is missing."""
    changes: dict[str, object] = {}
    for setting in settings or []:
        path, equals, text = setting.partition("=")
        if not equals or not path.strip():
            raise SceneError("--set", setting, "must be key=value, such as grid.rows=64")
        try:
            changes[path.strip()] = parse_value(text.strip())
        except ValueError as error:
            raise SceneError(f"--set {path.strip()}", text, str(error)) from None
    return changes
