"""What the commands that measure have in common: options, and how they run an experiment and tell of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from app.command.command_line import out, typed

Backends = Annotated[list[str] | None, typer.Option(help="Only this backend. Repeatable.")]
Integrators = Annotated[list[str] | None, typer.Option(help="Only this integrator. Repeatable.")]
Methods = Annotated[
    list[str] | None,
    typer.Option(
        help='Only this integrator or position-based method ("xpbd jacobi"; xpbd: all orderings). Repeatable.'
    ),
]
Precisions = Annotated[list[str] | None, typer.Option(help="Only float32, or float64. Repeatable.")]
RatePrecisions = Annotated[list[str] | None, typer.Option(help="float32 (the default), or float64. Repeatable.")]
Time = Annotated[float | None, typer.Option(help="Seconds simulated until it is judged (default 1.5).")]


def precisions_of(chosen: list[str] | None, *usual: str) -> tuple[str, ...]:
    """Those that were chosen, each once, else the `usual`, else all. Raises SceneError."""
    from model.core.simulation import PRECISIONS, Options

    return tuple(dict.fromkeys(Options(name).precision for name in chosen or usual or PRECISIONS))


def told(console: Console, summary: Any) -> None:
    """What an experiment did, in its own words."""
    console.print(str(summary), markup=False, soft_wrap=True)


def measure(
    path: Path,
    run: Callable[..., Any],
    show: Callable[[Console, Any, str], None] | None = None,
    tell: Callable[[Console, Any], None] = told,
    **how: Any,
) -> Any:
    """Run an experiment into the store, then tell what the store says of this machine (`show`) and what was done (`tell`);
    the summary. The exit status of Ctrl-C, if that ended it."""
    from bench.store.database import Store

    with Store(path) as store:
        summary = run(store, command=typed(), **how)
        if show is not None:
            show(out, store, summary.machine)
        tell(out, summary)
    if summary.interrupted:
        raise typer.Exit(130)
    return summary
