"""softlab inspect: the content of a mesh file and its possible roles."""

from __future__ import annotations

import json
from pathlib import Path

from rich.console import Console

from softlab.model.assets.inspection import inspected


def inspect_file(file: Path, out: Console, *, scale: float = 1.0, as_json: bool = False) -> None:
    """Print the inspection of `file`. Raises SceneError and InputError."""
    inspection = inspected(file, scale)
    if as_json:
        print(json.dumps(inspection.as_dict()))
        return
    for line in inspection.lines():
        out.print(line, markup=False, soft_wrap=True)
