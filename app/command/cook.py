"""softlab cook: makes a body of tetrahedra from a mesh, in a file."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from rich.console import Console

from softlab.app.command.waiting import waiting_shown
from softlab.model.assets.cooked import Repair, cooked, save
from softlab.model.assets.tetrahedral_body import DENSITY
from softlab.model.base.errors import SceneError
from softlab.model.base.files import check_target
from softlab.model.base.waiting import work
from softlab.model.geometry.tetrahedra.voxels import PerVoxel

CHOICES: dict[str, PerVoxel | Literal["conforming"]] = {"5": 5, "6": 6, "conforming": "conforming"}


def cook_body(
    source: str,
    target: Path,
    out: Console,
    *,
    edge: float | None = None,
    voxels: int | None = None,
    tetrahedra: str = "5",
    repair: Repair = Repair(),
    scale: float = 1.0,
    density: float = DENSITY,
) -> None:
    """Make the body of `source`, print its report and write it to `target` (.npz). Raises SceneError and InputError
    before anything is written."""
    check_target(target, (".npz",), "a body")
    if tetrahedra not in CHOICES:
        raise SceneError("--tetrahedra", tetrahedra, "must be 5 or 6 (per voxel), or conforming")
    with waiting_shown(), work(f"cooking {source}"):
        body = cooked(
            source, edge=edge, voxels=voxels, per_voxel=CHOICES[tetrahedra], repair=repair, scale=scale,
            density=density,
        )  # fmt: skip
        save(target, body)
    for line in body.report.lines():
        out.print(line, markup=False, soft_wrap=True)
    out.print(f"wrote {target}", markup=False, soft_wrap=True)
