"""Common parts of the commands that measure: options, and running and reporting an experiment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from softlab.app.command.command_line import out, typed
from softlab.model.base.components import component
from softlab.model.base.errors import SceneError

if TYPE_CHECKING:
    from softlab.bench.store.database import Store

Backends = Annotated[list[str] | None, typer.Option(help="Only this backend. Repeatable.")]
Precisions = Annotated[list[str] | None, typer.Option(help="Only float32, or float64. Repeatable.")]
Cluster = Annotated[
    str | None,
    typer.Option(
        metavar="local|slurm|dask://HOST:PORT",
        help="Measure in workers: processes here, Slurm jobs with a node each, or those of a Dask cluster.",
    ),
]
Workers = Annotated[
    int | None, typer.Option(help="With --cluster: how many (default: as many as can measure at once).")
]
Sbatch = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE", help="With --cluster slurm: an option of its jobs, e.g. partition=gpu. Repeatable."
    ),
]
Time = Annotated[float | None, typer.Option(help="Simulated seconds until the error is measured (default 1.5).")]


def precisions_of(chosen: list[str] | None, usual: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the chosen precisions, each once, else the `usual` ones, else all. Raises SceneError."""
    from softlab.model.core.simulation import PRECISIONS, Options

    return tuple(dict.fromkeys(Options(name).precision for name in chosen or usual or PRECISIONS))


def measure(
    path: Path,
    run: Callable[..., Any],
    how: Mapping[str, object],
    *,
    show: Callable[[Console, Store, str], None] | None = None,
    report: Callable[[Console, Any], None] | None = None,
    where: object = None,
    timed: bool = True,
) -> Any:
    """Run an experiment into the store, print its results (`show`) and the summary (`report`), and return the summary.

    `how`: the experiment's arguments; `where`: run in workers, each with its machine to itself if something is `timed`.
    Exits with the status of Ctrl-C if that ended it, and with 1 if something was abandoned.
    """
    from softlab.bench.store.database import Store

    with Store(path) as store:
        if where is not None:
            on_cluster = component("softlab.bench.cluster.start:on_cluster", "--cluster")
            summary = on_cluster(store, run, where, timed=timed, command=typed(), how=how)
        else:
            summary = run(store, command=typed(), **how)
        for machine in [summary.machine] if where is None else summary.machines:
            if show is not None:
                show(out, store, machine)
        if report is None:
            out.print(str(summary), markup=False, soft_wrap=True)
        else:
            report(out, summary)
        if where is not None:
            component("softlab.bench.cluster.summary:print_workers", "--cluster")(out, summary)
    if summary.interrupted:
        raise typer.Exit(130)
    if where is not None and (summary.abandoned or summary.unmerged):
        raise typer.Exit(1)
    return summary


def where_asked(cluster: str | None, workers: int | None, sbatch: list[str] | None) -> object:
    """Return the cluster to measure an experiment on; None: this process. Raises SceneError."""
    if cluster is None:
        for name, value in (("--workers", workers), ("--sbatch", sbatch)):
            if value is not None:
                raise SceneError(name, value, "goes with --cluster")
        return None
    return component("softlab.bench.cluster.pools:where_of", "--cluster")(cluster, workers, sbatch)
