"""The commands that measure, into the store, one function a sub-command; softlab/cli.py takes them among its own."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from softlab.app.command.command_line import DEFAULT_STORE, StorePath
from softlab.bench.measure.took import Timed
from softlab.bench.options import (
    Backends,
    Cluster,
    Integrators,
    Methods,
    Precisions,
    RatePrecisions,
    Sbatch,
    Workers,
    measure,
    precisions_of,
    where_asked,
)
from softlab.model.base.errors import SceneError

measuring = typer.Typer()


@measuring.command(
    cls=Timed, epilog="Example: softlab accuracy --quick   (softlab accuracy --integrator rk4 --precision float64)"
)
def accuracy(
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer repeats and methods, less float32, no exact math, one size.")
    ] = False,
    integrator: Methods = None,
    backend: Backends = None,
    precision: Precisions = None,
    names: Annotated[
        list[str] | None, typer.Argument(metavar="SCENE", help="Same as --scene.", show_default=False)
    ] = None,
    scene: Annotated[
        list[str] | None, typer.Option(help="Only S1 (lab-curtain), S2, S4, S5, S6 or S6-still. Repeatable.")
    ] = None,
    findings: Annotated[
        bool | None,
        typer.Option(
            help="Also run the small experiments behind single findings (default: only if nothing is selected)."
        ),
    ] = None,
    cluster: Cluster = None,
    workers: Workers = None,
    sbatch: Sbatch = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Measure error and speed of every method, step size and precision of grids and cloth (bodies: softlab bar)."""
    from softlab.bench.experiments.accuracy.experiment import run_accuracy
    from softlab.bench.experiments.accuracy.points import labels_of
    from softlab.bench.experiments.convergence import run_convergence
    from softlab.bench.experiments.findings.costs import run_costs
    from softlab.bench.experiments.findings.experiment import run_findings

    scenes = labels_of([*(names or []), *(scene or [])]) or None
    if findings is None:
        findings = not (integrator or precision or scenes)
    how: dict[str, Any] = {"quick": quick, "backends": backend, "where": where_asked(cluster, workers, sbatch)}
    measure(store, run_accuracy, integrators=integrator, precisions=precision, scenes=scenes, **how)
    for run in (run_findings, run_costs, run_convergence) if findings else ():
        measure(store, run, **how)


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
    measure(store, run_stability, where=where, timed=False, quick=quick, integrators=integrator, backends=backend)


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
        store, run_hard, report=print_hard, quick=quick, cases=case, integrators=integrator, backends=backend,
        precisions=precision, pictures=pictures,
    )  # fmt: skip
    if not summary.rows and not summary.interrupted:
        raise typer.Exit(2)  # what was chosen is run by none; print_hard says so
    if failed(summary):
        raise typer.Exit(1)


@measuring.command(
    cls=Timed, epilog="Example: softlab projections --quick   (softlab projections --backend cpu --size 256)"
)
def projections(
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="Two sizes, ten iterations, fewer neighbours and repeats, no published scenes: under a minute on two cores.",
        ),
    ] = False,
    backend: Backends = None,
    size: Annotated[list[int] | None, typer.Option(help="Only sheets of N x N masses. Repeatable.")] = None,
    tetrahedra: Annotated[
        bool, typer.Option("--tetrahedra", help="Measure bars of tetrahedra instead of sheets.")
    ] = False,
    precision: RatePrecisions = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Measure how many constraints per second the position-based solvers project, beside published cloth."""
    from softlab.bench.experiments.element_projections import print_element_projections, run_element_projections
    from softlab.bench.experiments.projections import print_projections, run_projections

    chosen = precisions_of(precision, ["float32"])
    if tetrahedra:
        if size:
            raise SceneError("--size", size[0], "applies to sheets; leave out --tetrahedra")
        run, show = run_element_projections, print_element_projections
        measure(store, run, show, quick=quick, backends=backend, precisions=chosen)
        return
    measure(store, run_projections, print_projections, quick=quick, backends=backend, sizes=size, precisions=chosen)


@measuring.command(
    cls=Timed, epilog="Example: softlab throughput --quick   (softlab throughput --backend cpu --kind heap)"
)
def throughput(
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="Fifty bodies, the smallest grid, no lattice, fewer repeats: under a minute on two cores."
        ),
    ] = False,
    backend: Backends = None,
    kind: Annotated[list[str] | None, typer.Option(help="Only soft, rigid, heap, grid or lattice. Repeatable.")] = None,
    precision: RatePrecisions = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Measure particles per second of soft bodies, rigid bodies, colliding heaps and lattices."""
    from softlab.bench.experiments.throughput import print_throughput, run_throughput

    chosen = precisions_of(precision, ["float32"])
    measure(store, run_throughput, print_throughput, quick=quick, backends=backend, kinds=kind, precisions=chosen)


@measuring.command(cls=Timed, epilog="Example: softlab fluids --quick   (softlab fluids --truth --peers)")
def fluids(
    quick: Annotated[
        bool, typer.Option("--quick", help="Only pools of 1000 and 8000 particles, fewer repeats.")
    ] = False,
    truth: Annotated[
        bool,
        typer.Option("--truth", help="Measure errors against known solutions, and the time per frame, instead."),
    ] = False,
    rest: Annotated[
        bool,
        typer.Option(
            "--rest",
            help="Measure energy and rms speed of water at rest over 60 s (--quick: one spacing, 10 s) instead.",
        ),
    ] = False,
    peers: Annotated[
        bool, typer.Option("--peers", help="With --truth or --rest: also measure other programs (SPlisHSPlasH).")
    ] = False,
    backend: Backends = None,
    precision: RatePrecisions = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Measure particles per second of fluids and the time of each stage, or (--truth) their errors, or (--rest) how still
    they stay."""
    if peers and not (truth or rest):
        raise SceneError("--peers", True, "applies to --truth and --rest; add one of them")
    if truth and rest:
        raise SceneError("--rest", True, "cannot be combined with --truth; leave one out")
    if precision and (truth or rest):
        raise SceneError("--precision", precision[0], "applies to speeds; leave out --truth and --rest")
    if rest:
        from softlab.bench.experiments.fluid_rest import print_rest, run_rest

        measure(store, run_rest, print_rest, quick=quick, backends=backend, peers=peers)
        return
    if truth:
        from softlab.bench.experiments.fluid_truth.experiment import run_truth
        from softlab.bench.experiments.fluid_truth.rows import print_truth

        measure(store, run_truth, print_truth, quick=quick, backends=backend, peers=peers)
        return
    from softlab.bench.experiments.fluids import print_fluids, run_fluids

    chosen = precisions_of(precision, ["float32"])
    measure(store, run_fluids, print_fluids, quick=quick, backends=backend, precisions=chosen)


@measuring.command(cls=Timed, epilog="Example: softlab busy --quick   (softlab busy --scene soft-pile)")
def busy(
    quick: Annotated[bool, typer.Option("--quick", help="Two scenes, fewer and shorter samples.")] = False,
    scene: Annotated[list[str] | None, typer.Option(help="Only this scene. Repeatable.")] = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Measure what another program on the machine costs CPU threads."""
    from softlab.bench.experiments.busy import print_busy, run_busy

    measure(store, run_busy, print_busy, quick=quick, scenes=scene or ())


@measuring.command(
    cls=Timed, epilog="Example: softlab tetrahedra --quick   (softlab tetrahedra --backend cpu --precision float64)"
)
def tetrahedra(
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="One mesh, few substeps and iterations, fewer repeats: half a minute on two cores."
        ),
    ] = False,
    across: Annotated[
        list[int] | None, typer.Option(help="Only bars of this many voxels across: 1, 2, 4 or 8. Repeatable.")
    ] = None,
    young: Annotated[
        list[float] | None, typer.Option(help="Only bars of this Young's modulus: 1e5, 1e6 or 1e7 Pa. Repeatable.")
    ] = None,
    solver: Annotated[
        list[str] | None,
        typer.Option(help="Only this solver: xpbd, 'xpbd blocks', vbd, newton or 'newton order 2'. Repeatable."),
    ] = None,
    backend: Backends = None,
    precision: RatePrecisions = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Measure the solver error and the mesh error of a bar of tetrahedra, and the fastest solver within 1 %."""
    from softlab.bench.experiments.tetrahedra import run_tetrahedra
    from softlab.bench.experiments.tetrahedral.decides import print_tetrahedra
    from softlab.bench.experiments.tetrahedral.meshes import print_meshes, run_meshes

    chosen = precisions_of(precision, ["float32"])
    picked: dict[str, Any] = {
        "precisions": chosen, "across": across or (), "young": young or (), "solvers": solver or ()
    }  # fmt: skip
    if not across and not young and not solver:  # of which a chosen bar is no part
        measure(store, run_meshes, print_meshes, quick=quick, backends=backend)
    measure(store, run_tetrahedra, print_tetrahedra, quick=quick, backends=backend, **picked)


@measuring.command(cls=Timed, epilog="Example: softlab bar --quick   (softlab bar --backend cpu)")
def bar(
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="Few spacings, substeps and clusters, no bending, float64 only: under a minute on two cores.",
        ),
    ] = False,
    backend: Backends = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Compare sag, frequency and shear of one bar under every method with the theory of its material; also the cost."""
    from softlab.bench.experiments.bar import run_bar
    from softlab.bench.experiments.bar_costs import print_bar_costs, run_bar_costs
    from softlab.bench.experiments.bar_rows import print_bar

    measure(store, run_bar, print_bar, quick=quick, backends=backend)
    measure(store, run_bar_costs, print_bar_costs, quick=quick, backends=backend)
