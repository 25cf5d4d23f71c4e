"""What the commands of softlab.py and bench/commands.py share: the options of several of them, and where they print to."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
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
Threads = Annotated[str, typer.Option(help="CPU threads: 1x, 2x, 4x the cores, or a number.")]
Precision = Annotated[str, typer.Option(help="float32 or float64.")]
Math = Annotated[str, typer.Option(help="fast, or exact (the same bits on every backend and thread count).")]
StorePath = Annotated[Path, typer.Option("--store", help="The store of measurements.")]
DEFAULT_STORE = Path("softlab-results") / "results.sqlite"


def scene_of(name: str, settings: list[str] | None) -> Any:
    """The scene of that name or file, with the fields of --set. Raises SceneError."""
    from model.scene import load_scene
    from model.scene_reader import parse_settings

    return load_scene(name).replace(parse_settings(settings))


@contextmanager
def compilations_told(console: Console = errors) -> Iterator[None]:
    """Within it, a terminal is told of each kernel that is compiled, and how long that took last time on this machine."""
    from model.kernel_cache import watched

    def tell(label: str, seconds: float | None) -> None:
        if console.is_terminal and (seconds is None or seconds >= 1.0):
            last = "for the first time here" if seconds is None else f"took {seconds:.0f} s last time"
            console.print(f"compiling {label}: {last}", markup=False)

    with watched(tell):
        yield


def typed() -> str:
    """The command as it was typed, for the store."""
    return " ".join(["softlab", *sys.argv[1:]])
