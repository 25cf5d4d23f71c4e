"""What the commands of softlab.py and bench/commands.py share: the options of several of them, and where they print to."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

errors = Console(stderr=True, highlight=False, soft_wrap=True)
out = Console(highlight=False)

SceneName = Annotated[str, typer.Argument(metavar="SCENE", help="A name that `softlab scenes` lists, or a .toml file.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a field, e.g. grid.rows=64. Repeatable."),
]
Backend = Annotated[str, typer.Option(help="cpu or gpu.")]
Threads = Annotated[
    str, typer.Option(help="CPU threads: 1x, 2x, 4x the cores, a number, or auto: 1x, or 1 where that is quicker now.")
]
Precision = Annotated[str, typer.Option(help="float32 or float64.")]
Math = Annotated[str, typer.Option(help="fast, or exact (the same bits on every backend and thread count).")]
StorePath = Annotated[Path, typer.Option("--store", help="The store of measurements.")]
DEFAULT_STORE = Path("softlab-results") / "results.sqlite"


def scene_of(name: str, settings: list[str] | None) -> Any:
    """The scene of that name or file, with the fields of --set. Raises SceneError."""
    from model.scene import load_scene
    from model.scene_reader import parse_settings

    return load_scene(name).replace(parse_settings(settings))


def typed() -> str:
    """The command as it was typed, for the store."""
    return " ".join(["softlab", *sys.argv[1:]])
