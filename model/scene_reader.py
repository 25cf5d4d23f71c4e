"""Where scenes come from: catalogue, files, what a command line sets; as tables, of which model/scene.py makes objects."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from model.body_parts import BODY_KINDS
from model.cloth_parts import SURFACE_KINDS
from model.errors import InputError, SceneError
from model.scene_words import suggestion
from model.topology import is_file, own_meshes

OF_MESHES = ("mesh", *SURFACE_KINDS, *BODY_KINDS)  # kinds of part that may name a file


def catalogue() -> dict[str, Path]:
    """The named scenes that come with the lab: name -> TOML file."""
    root = Path(str(resources.files("model"))) / "catalogue"
    return {file.relative_to(root).with_suffix("").as_posix(): file for file in sorted(root.rglob("*.toml"))}


def scene_tables(name_or_path: str | Path) -> tuple[dict[str, Any], str]:
    """(tables, name) of a catalogue name (`lab-grid`) or of a TOML file, the meshes that it names found (see `with_meshes`).

    Raises InputError (no such name, unreadable, not TOML, no such mesh).
    """
    text = str(name_or_path)
    known = catalogue()
    if text in ("", "."):
        raise InputError(f"{text!r} is a directory or nothing; a scene is one of {', '.join(known)}, or a .toml file")
    path = known.get(text)
    if path is None:
        path = Path(text)
        folders = {name.split("/")[0] for name in known if "/" in name}
        inside = len(path.parts) <= 1 or path.parts[0] in folders
        looks_like_a_name = path.suffix == "" and inside and not path.exists()
        if looks_like_a_name:
            raise InputError(
                f"unknown scene {text!r}{suggestion(text, known)}; known: {', '.join(known)}, or a .toml file"
            )
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except IsADirectoryError:
        raise InputError(f"{text} is a directory; a scene is a .toml file") from None
    except FileNotFoundError:
        raise InputError(f"{text}: no such file; `softlab scenes` lists the scenes that come with the lab") from None
    except (OSError, ValueError) as error:
        if isinstance(error, tomllib.TOMLDecodeError):
            raise InputError(f"{text} is not TOML: {error}") from None
        if isinstance(error, UnicodeDecodeError):
            raise InputError(f"{text} is not a text file in UTF-8; a scene is a .toml file") from None
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{text} cannot be read: {reason}") from None
    return with_meshes(data, path.parent), text if text in known else path.stem


def with_meshes(tables: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The tables of a scene that lies in `folder`, the files of its meshes by their whole path: so that what is written of it
    anywhere (a store, a trajectory, another scene file) can be read from anywhere.

    A file is looked for beside the scene, then among the lab's own, which keep their name, then from the current folder.
    Raises InputError, naming where.
    """
    found = dict(tables)
    for name, table in tables.items():
        if not isinstance(table, Mapping) or table.get("kind", name) not in OF_MESHES:
            continue
        file = table.get("file")
        if isinstance(file, str):
            found[name] = {**table, "file": _found(f"{name}.file", file, folder)}
    return found


def _found(field: str, file: str, folder: Path) -> str:
    beside, here, own = (folder / file).absolute(), Path(file).absolute(), own_meshes()
    if is_file(beside):
        return str(beside)
    if file in own:
        return file
    if is_file(here):
        return str(here)
    places = f"neither {beside} (beside the scene) nor {here} (from the current folder)"
    if beside == here:
        places = f"looked for {here}"
    raise InputError(f"{field} = {file}: no such file: {places}; the lab's own meshes: {', '.join(own)}")


def parse_value(text: str) -> Any:
    """The value of `--set key=value`: read as TOML (numbers, true, lists), else taken as a plain word."""
    try:
        parsed = tomllib.loads(f"value = {text}")
        return parsed["value"] if set(parsed) == {"value"} else text
    except tomllib.TOMLDecodeError:
        return text


def parse_settings(settings: list[str] | None) -> dict[str, Any]:
    """`["grid.rows=64", ...]` as {path: value}. Raises SceneError where the equals sign is missing."""
    changes: dict[str, Any] = {}
    for setting in settings or []:
        path, equals, text = setting.partition("=")
        if not equals or not path.strip():
            raise SceneError("--set", setting, "must be key=value, such as grid.rows=64")
        changes[path.strip()] = parse_value(text.strip())
    return changes
