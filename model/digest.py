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
