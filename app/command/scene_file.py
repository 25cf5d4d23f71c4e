"""Scene files: writes a scene as the TOML that `load_scene` reads. An error leaves no partial file."""

from __future__ import annotations

import json
import re
from pathlib import Path

from softlab.model.base.errors import InputError
from softlab.model.base.files import check_target, replacing
from softlab.model.scene.scene import Scene

SUFFIX = ".toml"
BARE = re.compile(r"[A-Za-z0-9_-]+")  # a TOML key that needs no quotes


def scene_toml(scene: Scene, heading: str = "") -> str:
    """Return the scene as TOML text, including defaults; read back it is the same scene to the last digit.

    `heading`: lines put before it as comments.
    """
    lines = [f"# {line}" for line in heading.splitlines()]
    tables = scene.whole.as_dict()
    lines.append(f"title = {_value(tables.pop('title'))}")
    for name, table in tables.items():
        lines += [
            "",
            f"[{_key(name)}]",
            *(f"{_key(field)} = {_value(value)}" for field, value in table.items() if value is not None),
        ]
    return "\n".join(lines) + "\n"


def _key(name: str) -> str:
    return name if BARE.fullmatch(name) else _value(name)


def _value(value: object) -> str:
    """Return a TOML value. JSON's strings, numbers and booleans are valid TOML, except that TOML requires DEL to be
    escaped; fields without a value are left out."""
    if isinstance(value, dict):
        fields = [f"{_key(name)} = {_value(one)}" for name, one in value.items() if one is not None]
        return f"{{ {', '.join(fields)} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def check_scene_target(path: Path | str, force: bool = False) -> Path:
    """Return `path`, if a scene could be written there. Raises InputError, naming a file that exists unless `force`."""
    target = check_target(path, (SUFFIX,), "a scene file")
    if target.exists() and not force:
        raise InputError(f"{target} exists already; give another name, or pass --force to replace it")
    return target


def write_scene(path: Path | str, scene: Scene, heading: str = "", *, force: bool = False) -> Path:
    """Write the scene to `path` (.toml) and return it. Raises InputError; an older file survives a failure."""
    target = check_scene_target(path, force)
    with replacing(target) as temporary:
        temporary.write_text(scene_toml(scene, heading), encoding="utf-8")
    return target
