"""A hash of source files: what was compiled or measured from other sources is compiled or measured anew."""

from __future__ import annotations

import hashlib
from pathlib import Path


def source_digest(*places: Path) -> str:
    """A hash of the Python files named, and of every one in the folders named."""
    digest = hashlib.sha256()
    for place in places:
        for file in sorted(place.glob("*.py")) if place.is_dir() else [place]:
            digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


MOST_NAME = 150  # characters: with a module, a hash and a suffix still a file's name, which may have 255


def file_name(name: str) -> str:
    """The name, its end replaced by a hash where it is too long for a file: as different as before."""
    if len(name) <= MOST_NAME:
        return name
    return f"{name[: MOST_NAME - 17]}_{hashlib.sha256(name.encode()).hexdigest()[:16]}"
