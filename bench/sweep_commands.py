"""`softlab sweep`, into the store; softlab/cli.py adds it to its commands."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated

import typer

from softlab.app.command.command_line import DEFAULT_STORE, StorePath
from softlab.app.command.options_class import with_options
from softlab.bench.measure.took import Timed
from softlab.bench.options import Backends, Cluster, Precisions, Sbatch, Workers, measure, precisions_of, where_asked
from softlab.model.base.components import component
from softlab.model.base.errors import SceneError

sweeping = typer.Typer()


@dataclass(frozen=True)
class SweepOptions:
    """The options of `softlab sweep`."""

    quick: Annotated[bool, typer.Option("--quick", help="Small sizes only; takes a quarter of a minute.")] = False
    backend: Backends = None
    size: Annotated[list[int] | None, typer.Option(help="Only grids of N x N masses. Repeatable.")] = None
    max_seconds: Annotated[float | None, typer.Option(help="Time limit of one configuration in seconds.")] = None
    total_seconds: Annotated[float | None, typer.Option(help="Start no new configuration after this many seconds.")] = (
        None
    )
    graphics: Annotated[bool, typer.Option(help="Also measure with off-screen drawing every 10 steps.")] = True
    repeats: Annotated[int | None, typer.Option(help="Number of samples per configuration.")] = None
    min_ms: Annotated[float | None, typer.Option("--min-ms", help="Shortest duration of a sample in milliseconds.")] = (
        None
    )
    precision: Precisions = None
    again: Annotated[bool, typer.Option(help="Repeat samples that were disturbed by other programs.")] = True
    threads: Annotated[
        list[str] | None, typer.Option(help="Only these CPU threads: 1x, 2x, 4x or a number. Repeatable.")
    ] = None
    kernels: Annotated[
        bool, typer.Option("--kernels", help="Measure every kernel instead of the automatic choice.")
    ] = False
    kernel: Annotated[list[str] | None, typer.Option(help="With --kernels: only this kernel. Repeatable.")] = None
    energy: Annotated[
        bool, typer.Option(help="With --kernels: also measure energy in joules, where the machine can.")
    ] = True
    starts: Annotated[bool, typer.Option(help="With --kernels: also measure the time to the first step.")] = True
    peers: Annotated[
        bool,
        typer.Option("--peers", help="Measure other implementations beside it (NumPy, C++, CUDA C++, Warp, Newton)."),
    ] = False
    scene: Annotated[
        list[str] | None,
        typer.Option(
            help="With --peers only grid, cloth, xpbd, implicit (-16, -4, -1), tetrahedra (-1e5 ...) or rigid (repeatable); "
            "with --gpus: grid, xpbd or xpbd-jacobi."
        ),
    ] = None
    gpus: Annotated[
        list[int] | None,
        typer.Option(help="Measure a sheet on this many GPUs against one. Repeatable; see also --link."),
    ] = None
    link: Annotated[list[str] | None, typer.Option(help="With --gpus: flags (default) or nccl. Repeatable.")] = None
    exchange_every: Annotated[int | None, typer.Option(help="With --gpus: steps between two exchanges.")] = None
    weak: Annotated[bool, typer.Option("--weak", help="With --gpus: N x N masses for each GPU (weak scaling).")] = False
    cluster: Cluster = None
    workers: Workers = None
    sbatch: Sbatch = None
    store: StorePath = DEFAULT_STORE


@sweeping.command(
    cls=Timed,
    epilog="Example: softlab sweep --quick --backend cpu   (on a cluster: softlab sweep --cluster slurm --workers 8 "
    "--sbatch partition=cpu)",
)
@with_options(SweepOptions)
def sweep(options: SweepOptions) -> None:
    """Time grid sizes, backends, threads and precisions, with and without graphics. Resumes where it stopped."""
    from softlab.bench.experiments.sweep import check_positive

    check_together(options)
    check_positive("--min-ms", options.min_ms)
    where = where_asked(options.cluster, options.workers, options.sbatch)
    if options.gpus:
        _sweep_gpus(options)
    else:
        _sweep_sizes(options, where)


def _sweep_gpus(options: SweepOptions) -> None:
    """Time sheets on several GPUs. Raises SceneError."""
    from softlab.bench.experiments.scaling.experiment import SCENES, Scaling

    for word in options.scene or ["grid"]:
        if word not in SCENES:
            raise SceneError("--scene", word, f"with --gpus one of {', '.join(SCENES)}")
        how: dict[str, object] = {
            "quick": options.quick, "backends": options.backend or ["gpu"], "scene": word, "gpus": options.gpus,
            "precisions": precisions_of(options.precision, ["float32"]), "sizes": options.size,
            "exchange_every": options.exchange_every, "weak": options.weak,
        }  # fmt: skip
        how |= {"links": options.link} if options.link else {}
        measure(options.store, Scaling(), how, show=Scaling().show)


def _sweep_sizes(options: SweepOptions, where: object) -> None:
    """Time sizes, kernels or peers on one processor, or on the workers of `where`."""
    from softlab.bench.experiments.sweep import THREADS, run_sweep
    from softlab.bench.measure.tables import print_kernels, print_sweep

    how: dict[str, object] = {
        "quick": options.quick, "backends": options.backend, "sizes": options.size, "max_seconds": options.max_seconds,
        "total_seconds": options.total_seconds, "repeats": options.repeats,
        "min_seconds": options.min_ms and options.min_ms / 1000, "precisions": precisions_of(options.precision),
    }  # fmt: skip
    run = partial(measure, options.store, report=print_sweep)
    if options.kernels:
        from softlab.bench.experiments.kernel_sweep import run_kernel_sweep

        how |= {"kernels": options.kernel, "energy": options.energy, "starts": options.starts, "again": options.again}
        run(run_kernel_sweep, how, show=print_kernels, where=where)
    elif options.peers:
        run_peers = component("softlab.bench.peers.sweep:run_peers", "--peers")
        show = component("softlab.bench.peers.results:print_peers", "--peers")
        run(run_peers, how | {"scenes": options.scene}, show=show)
    else:
        threads = options.threads or THREADS
        how |= {"graphics": options.graphics, "threads": threads, "again": options.again}
        run(run_sweep, how, where=where)


def check_together(options: SweepOptions) -> None:
    """Refuse options that do not go together. Raises SceneError."""
    if options.peers and (options.kernels or options.kernel):
        raise SceneError("--peers", True, "cannot be combined with --kernels and --kernel; leave them out")
    if options.threads and (options.peers or options.kernels):
        raise SceneError(
            "--threads", options.threads[0], "cannot be combined with --kernels or --peers; leave them out"
        )
    if options.scene and not (options.peers or options.gpus):
        raise SceneError("--scene", options.scene[0], "applies to --peers or --gpus; add one of them")
    if options.kernel and not options.kernels:
        raise SceneError("--kernel", options.kernel[0], "applies to --kernels; add --kernels")
    if options.cluster and options.peers:
        raise SceneError(
            "--cluster",
            options.cluster,
            "cannot be combined with --peers, which are built on the machine that times them; leave one out",
        )
    shared = {"--weak": options.weak, "--link": options.link, "--exchange-every": options.exchange_every}
    for option, value in shared.items():
        if value not in (None, False, []) and not options.gpus:
            raise SceneError(option, value, "applies to a sheet on several GPUs; add --gpus N")
    for count in options.gpus or ():
        if count < 1:
            raise SceneError("--gpus", count, "must be at least 1")
    if options.gpus and (options.peers or options.kernels or options.threads or options.cluster):
        raise SceneError(
            "--gpus", options.gpus, "cannot be combined with --peers, --kernels, --threads or --cluster; leave them out"
        )
