"""The commands that measure, into the store, one function a sub-command; softlab.py takes them among its own."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from app.command.command_line import DEFAULT_STORE, StorePath
from bench.measure.took import Timed
from bench.options import (
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
from model.core.errors import SceneError

measuring = typer.Typer()


@measuring.command(
    cls=Timed,
    epilog="Example: softlab sweep --quick --backend cpu   (on a cluster: softlab sweep --cluster slurm --workers 8 "
    "--sbatch partition=cpu)",
)
def sweep(
    quick: Annotated[bool, typer.Option("--quick", help="Small sizes, a quarter of a minute.")] = False,
    backend: Backends = None,
    size: Annotated[list[int] | None, typer.Option(help="Only N x N masses. Repeatable.")] = None,
    max_seconds: Annotated[float | None, typer.Option(help="The most one configuration may take.")] = None,
    total_seconds: Annotated[float | None, typer.Option(help="Start nothing new after so long.")] = None,
    graphics: Annotated[bool, typer.Option(help="Also with off-screen drawing every 10 steps.")] = True,
    repeats: Annotated[int | None, typer.Option(help="Samples of a configuration.")] = None,
    min_ms: Annotated[float | None, typer.Option("--min-ms", help="The least milliseconds of a sample.")] = None,
    precision: Precisions = None,
    again: Annotated[bool, typer.Option(help="Sample once more what other programs disturbed.")] = True,
    threads: Annotated[list[str] | None, typer.Option(help="On the CPU: 1x, 2x, 4x or a number. Repeatable.")] = None,
    kernels: Annotated[
        bool, typer.Option("--kernels", help="Every kernel, forced, instead of the chosen one.")
    ] = False,
    kernel: Annotated[list[str] | None, typer.Option(help="With --kernels: only this one. Repeatable.")] = None,
    energy: Annotated[bool, typer.Option(help="With --kernels: joules, where the machine counts them.")] = True,
    starts: Annotated[bool, typer.Option(help="With --kernels: the time to a first step, too.")] = True,
    peers: Annotated[
        bool,
        typer.Option(
            "--peers", help="Side by side with what you could use instead (NumPy, C++, CUDA C++, Warp, Newton)."
        ),
    ] = False,
    scene: Annotated[
        list[str] | None,
        typer.Option(
            help="With --peers: only grid, cloth, xpbd, implicit (-16, -4, -1), tetrahedra (-1e5 ...) or rigid. Repeatable."
        ),
    ] = None,
    gpus: Annotated[
        list[int] | None, typer.Option(help="A grid on so many GPUs, beside one, instead. Repeatable; see also --link.")
    ] = None,
    link: Annotated[str, typer.Option(help="With --gpus: peer or flags.")] = "peer",
    exchange_every: Annotated[int | None, typer.Option(help="With --gpus: steps between two exchanges.")] = None,
    weak: Annotated[
        bool, typer.Option("--weak", help="With --gpus: N x N masses for each GPU (weak scaling).")
    ] = False,
    cluster: Cluster = None,
    workers: Workers = None,
    sbatch: Sbatch = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Time sizes x backends x threads x precisions, with and without graphics, into the store. Resumes where it stopped."""
    from bench.experiments.sweep import THREADS, check_positive, run_sweep
    from bench.store.tables import print_kernels, print_sweep

    if peers and (kernels or kernel):
        raise SceneError("--peers", True, "is a sweep of its own; leave out --kernels and --kernel")
    if threads and (peers or kernels):
        raise SceneError("--threads", threads[0], "is for the ordinary sweep; leave out --kernels and --peers")
    if scene and not peers:
        raise SceneError("--scene", scene[0], "chooses among those of --peers; add --peers")
    if kernel and not kernels:
        raise SceneError("--kernel", kernel[0], "chooses among those of --kernels; add --kernels")
    if cluster and peers:
        raise SceneError(
            "--cluster", cluster, "does not go with --peers, which are built on the machine that times them"
        )
    check_positive("--min-ms", min_ms)
    if weak and not gpus:
        raise SceneError("--weak", True, "is for a grid on several GPUs; add --gpus")
    where = where_asked(cluster, workers, sbatch)
    if gpus:
        from bench.experiments.scaling.experiment import print_scaling, run_scaling

        if peers or kernels or threads or cluster:
            raise SceneError(
                "--gpus", gpus, "is a sweep of its own; leave out --peers, --kernels, --threads and --cluster"
            )
        shared: dict[str, Any] = {
            "gpus": gpus,
            "sizes": size,
            "link": link,
            "exchange_every": exchange_every,
            "weak": weak,
        }
        chosen = precisions_of(precision, "float32")
        measure(
            store, run_scaling, print_scaling, quick=quick, backends=backend or ["gpu"], precisions=chosen, **shared
        )
        return
    how: dict[str, Any] = {
        "quick": quick, "backends": backend, "sizes": size, "max_seconds": max_seconds, "total_seconds": total_seconds,
        "repeats": repeats, "min_seconds": min_ms and min_ms / 1000, "precisions": precisions_of(precision),
        "tell": print_sweep,
    }  # fmt: skip
    if kernels:
        from bench.experiments.kernel_sweep import run_kernel_sweep

        how |= {"kernels": kernel, "energy": energy, "starts": starts, "again": again}
        measure(store, run_kernel_sweep, print_kernels, where=where, **how)
    elif peers:
        from bench.peers.results import print_peers
        from bench.peers.sweep import run_peers

        measure(store, run_peers, print_peers, scenes=scene, **how)
    else:
        measure(store, run_sweep, where=where, graphics=graphics, threads=threads or THREADS, again=again, **how)


@measuring.command(
    cls=Timed, epilog="Example: softlab accuracy --quick   (softlab accuracy --integrator rk4 --precision float64)"
)
def accuracy(
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer repeats, methods and float32; neither exact math nor other sizes.")
    ] = False,
    integrator: Methods = None,
    backend: Backends = None,
    precision: Precisions = None,
    names: Annotated[list[str] | None, typer.Argument(metavar="SCENE", help="As --scene.", show_default=False)] = None,
    scene: Annotated[
        list[str] | None, typer.Option(help="Only S1 (lab-curtain), S2, S4, S5, S6 or S6-still. Repeatable.")
    ] = None,
    findings: Annotated[
        bool | None,
        typer.Option(help="Also the small experiments behind single findings (default: unless a part is chosen)."),
    ] = None,
    cluster: Cluster = None,
    workers: Workers = None,
    sbatch: Sbatch = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Hold every method, step size and precision against a converged reference: speed against error (bodies: softlab bar)."""
    from bench.experiments.accuracy.experiment import run_accuracy
    from bench.experiments.accuracy.points import labels_of
    from bench.experiments.convergence import run_convergence
    from bench.experiments.findings import run_findings
    from bench.experiments.findings_costs import run_costs

    scenes = labels_of([*(names or []), *(scene or [])]) or None
    if findings is None:
        findings = not (integrator or precision or scenes)
    how: dict[str, Any] = {"quick": quick, "backends": backend, "where": where_asked(cluster, workers, sbatch)}
    measure(store, run_accuracy, integrators=integrator, precisions=precision, scenes=scenes, **how)
    for run in (run_findings, run_costs, run_convergence) if findings else ():
        measure(store, run, **how)


@measuring.command(cls=Timed, epilog="Example: softlab stability --quick   (softlab stability --integrator rk4)")
def stability(
    quick: Annotated[bool, typer.Option("--quick", help="A coarser map, fewer edges, little of float32.")] = False,
    integrator: Integrators = None,
    backend: Backends = None,
    cluster: Cluster = None,
    workers: Workers = None,
    sbatch: Sbatch = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Find where every integrator breaks: outcomes over step size, stiffness and damping, and the edge by bisection."""
    from bench.experiments.stability.experiment import run_stability

    where = where_asked(cluster, workers, sbatch)
    measure(store, run_stability, where=where, timed=False, quick=quick, integrators=integrator, backends=backend)


@measuring.command(cls=Timed, epilog="Example: softlab hard --quick   (softlab hard --case B5 --integrator rk4)")
def hard(
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="The hand-out's step, velocity Verlet, some of fluids, in float64, no bodies: under a minute on two cores.",
        ),
    ] = False,
    case: Annotated[list[str] | None, typer.Option(help="Only this row (B5) or case. Repeatable.")] = None,
    integrator: Methods = None,
    backend: Backends = None,
    precision: Precisions = None,
    pictures: Annotated[bool, typer.Option(help="End states as PNG, in the folder hard beside the store.")] = True,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Run the hard cases: grids collapsed, flipped, poked, far away, bodies squashed, shot, stacked (--integrator
    shape-matching); pass, fail, or refused with a diagnosis."""
    from bench.stress.experiment import run_hard
    from bench.stress.results import failed, print_hard

    summary = measure(
        store, run_hard, tell=print_hard, quick=quick, cases=case, integrators=integrator, backends=backend,
        precisions=precision, pictures=pictures,
    )  # fmt: skip
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
            help="Two sizes, ten iterations, fewer neighbours and repeats, nothing published: under a minute on two cores.",
        ),
    ] = False,
    backend: Backends = None,
    size: Annotated[list[int] | None, typer.Option(help="Only sheets of N x N masses. Repeatable.")] = None,
    tetrahedra: Annotated[bool, typer.Option("--tetrahedra", help="Bars of tetrahedra instead of sheets.")] = False,
    precision: RatePrecisions = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Time the position-based solvers: how many constraints a second they project, and published cloth beside ours."""
    from bench.experiments.element_projections import print_element_projections, run_element_projections
    from bench.experiments.projections import print_projections, run_projections

    chosen = precisions_of(precision, "float32")
    if tetrahedra:
        if size:
            raise SceneError("--size", size[0], "is of sheets; leave out --tetrahedra")
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
    """Time bodies: how many particles a second, soft, rigid, in a heap that collides, the grid and a cube as jelly."""
    from bench.experiments.throughput import print_throughput, run_throughput

    chosen = precisions_of(precision, "float32")
    measure(store, run_throughput, print_throughput, quick=quick, backends=backend, kinds=kind, precisions=chosen)


@measuring.command(cls=Timed, epilog="Example: softlab fluids --quick   (softlab fluids --truth --peers)")
def fluids(
    quick: Annotated[
        bool, typer.Option("--quick", help="Pools of a thousand and of eight thousand particles, fewer repeats.")
    ] = False,
    truth: Annotated[
        bool,
        typer.Option("--truth", help="Instead: how far schemes are off what is known, and what their frames take."),
    ] = False,
    peers: Annotated[bool, typer.Option("--peers", help="With --truth: beside other programs (SPlisHSPlasH).")] = False,
    backend: Backends = None,
    precision: RatePrecisions = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Time fluids: how many particles a second, what sorting, lists, densities, corrections take; or judge them (--truth)."""
    if truth or peers:
        from bench.experiments.fluid_truth.experiment import run_truth
        from bench.experiments.fluid_truth.rows import print_truth

        measure(store, run_truth, print_truth, quick=quick, backends=backend, peers=peers)
        return
    from bench.experiments.fluids import print_fluids, run_fluids

    chosen = precisions_of(precision, "float32")
    measure(store, run_fluids, print_fluids, quick=quick, backends=backend, precisions=chosen)


@measuring.command(cls=Timed, epilog="Example: softlab busy --quick   (softlab busy --scene soft-pile)")
def busy(
    quick: Annotated[bool, typer.Option("--quick", help="Two scenes, fewer and shorter samples.")] = False,
    scene: Annotated[list[str] | None, typer.Option(help="Only this scene. Repeatable.")] = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Time CPU threads beside another program: on one thread and on one a core, alone, beside a niced and a busy one."""
    from bench.experiments.busy import print_busy, run_busy

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
        list[int] | None, typer.Option(help="Only bars so many voxels across: 1, 2, 4 or 8. Repeatable.")
    ] = None,
    young: Annotated[
        list[float] | None, typer.Option(help="Only bars of this Young's modulus: 1e5, 1e6 or 1e7 Pa. Repeatable.")
    ] = None,
    backend: Backends = None,
    precision: RatePrecisions = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Does E mean E? A bar of tetrahedra: how far its solver and its mesh are off; which is soonest within 1 %."""
    from bench.experiments.tetrahedra import run_tetrahedra
    from bench.experiments.tetrahedral.decides import print_tetrahedra
    from bench.experiments.tetrahedral.meshes import print_meshes, run_meshes

    chosen = precisions_of(precision, "float32")
    picked: dict[str, Any] = {"precisions": chosen, "across": across or (), "young": young or ()}
    if not across and not young:  # of which a chosen bar is no part
        measure(store, run_meshes, print_meshes, quick=quick, backends=backend)
    measure(store, run_tetrahedra, print_tetrahedra, quick=quick, backends=backend, **picked)


@measuring.command(cls=Timed, epilog="Example: softlab bar --quick   (softlab bar --backend cpu)")
def bar(
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="Few spacings, substeps and clusters, no bending, laws in float64 alone: under a minute on two cores.",
        ),
    ] = False,
    backend: Backends = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Every method, one body: sag, frequency and shear of a bar against what its material says, its cost; laws of bodies."""
    from bench.experiments.bar import run_bar
    from bench.experiments.bar_costs import print_bar_costs, run_bar_costs
    from bench.experiments.bar_rows import print_bar

    measure(store, run_bar, print_bar, quick=quick, backends=backend)
    measure(store, run_bar_costs, print_bar_costs, quick=quick, backends=backend)
