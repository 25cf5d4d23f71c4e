"""The commands that measure, into the store, one function per sub-command; softlab/cli.py adds them to its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from softlab.app.command.command_line import DEFAULT_STORE, StorePath
from softlab.app.command.options_class import with_options
from softlab.bench.measure.took import Timed
from softlab.bench.options import (
    Backends,
    Cluster,
    Integrators,
    Methods,
    Precisions,
    Sbatch,
    Workers,
    measure,
    where_asked,
)

measuring = typer.Typer()


@dataclass(frozen=True)
class AccuracyOptions:
    """The options of `softlab accuracy`."""

    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer repeats and methods, less float32, no exact math, one size.")
    ] = False
    integrator: Methods = None
    backend: Backends = None
    precision: Precisions = None
    names: Annotated[list[str] | None, typer.Argument(metavar="SCENE", help="Same as --scene.", show_default=False)] = (
        None
    )
    scene: Annotated[
        list[str] | None, typer.Option(help="Only S1 (lab-curtain), S2, S4, S5, S6 or S6-still. Repeatable.")
    ] = None
    findings: Annotated[
        bool | None,
        typer.Option(
            help="Also run the small experiments behind single findings (default: only if nothing is selected)."
        ),
    ] = None
    cluster: Cluster = None
    workers: Workers = None
    sbatch: Sbatch = None
    store: StorePath = DEFAULT_STORE


@measuring.command(
    cls=Timed, epilog="Example: softlab accuracy --quick   (softlab accuracy --integrator rk4 --precision float64)"
)
@with_options(AccuracyOptions)
def accuracy(options: AccuracyOptions) -> None:
    """Measure error and speed of every method, step size and precision of grids and cloth (bodies: softlab bar)."""
    from softlab.bench.experiments.accuracy.experiment import run_accuracy
    from softlab.bench.experiments.accuracy.points import labels_of
    from softlab.bench.experiments.registry import experiments

    scenes = labels_of([*(options.names or []), *(options.scene or [])]) or None
    selected = options.integrator or options.precision or scenes
    findings = not selected if options.findings is None else options.findings
    where = where_asked(options.cluster, options.workers, options.sbatch)
    how: dict[str, object] = {"quick": options.quick, "backends": options.backend}
    chosen = {"integrators": options.integrator, "precisions": options.precision, "scenes": scenes}
    measure(options.store, run_accuracy, how | chosen, where=where)
    for one in experiments("accuracy") if findings else ():
        measure(options.store, one, how, where=where)


@measuring.command(cls=Timed, epilog="Example: softlab stability --quick   (softlab stability --integrator rk4)")
def stability(
    quick: Annotated[bool, typer.Option("--quick", help="A coarser map, fewer limits, less float32.")] = False,
    integrator: Integrators = None,
    backend: Backends = None,
    cluster: Cluster = None,
    workers: Workers = None,
    sbatch: Sbatch = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Measure the stability limit of every integrator over step size, stiffness and damping."""
    from softlab.bench.experiments.stability.experiment import run_stability

    where = where_asked(cluster, workers, sbatch)
    how = {"quick": quick, "integrators": integrator, "backends": backend}
    measure(store, run_stability, how, where=where, timed=False)


@measuring.command(cls=Timed, epilog="Example: softlab hard --quick   (softlab hard --case B5 --integrator rk4)")
def hard(
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="Only the lab step, velocity Verlet and some fluids, in float64, no bodies: under a minute on two cores.",
        ),
    ] = False,
    case: Annotated[list[str] | None, typer.Option(help="Only this case, by number (B5) or name. Repeatable.")] = None,
    integrator: Methods = None,
    backend: Backends = None,
    precision: Precisions = None,
    pictures: Annotated[
        bool, typer.Option(help="Write the final states as PNG to the folder hard beside the database.")
    ] = True,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Run the hard cases (collapsed, flipped, far away, squashed, stacked ...): each passes, fails, or is refused with a
    diagnosis."""
    from softlab.bench.stress.experiment import run_hard
    from softlab.bench.stress.report import print_hard
    from softlab.bench.stress.results import failed

    summary = measure(
        store,
        run_hard,
        {
            "quick": quick, "cases": case, "integrators": integrator, "backends": backend, "precisions": precision,
            "pictures": pictures,
        },
        report=print_hard,
    )  # fmt: skip
    if not summary.rows and not summary.interrupted:
        raise typer.Exit(2)  # what was chosen is run by none; print_hard says so
    if failed(summary):
        raise typer.Exit(1)
