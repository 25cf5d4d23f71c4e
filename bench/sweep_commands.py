"""`softlab sweep`, into the store; softlab/cli.py adds it to its commands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import typer

from softlab.app.command.command_line import DEFAULT_STORE, StorePath
from softlab.bench.measure.took import Timed
from softlab.bench.options import Backends, Cluster, Precisions, Sbatch, Workers, measure, precisions_of, where_asked
from softlab.model.base.components import component
from softlab.model.base.errors import SceneError

sweeping = typer.Typer()


@sweeping.command(
    cls=Timed,
    epilog="Example: softlab sweep --quick --backend cpu   (on a cluster: softlab sweep --cluster slurm --workers 8 "
    "--sbatch partition=cpu)",
)
def sweep(
    quick: Annotated[bool, typer.Option("--quick", help="Small sizes only; takes a quarter of a minute.")] = False,
    backend: Backends = None,
    size: Annotated[list[int] | None, typer.Option(help="Only grids of N x N masses. Repeatable.")] = None,
    max_seconds: Annotated[float | None, typer.Option(help="Time limit of one configuration in seconds.")] = None,
    total_seconds: Annotated[
        float | None, typer.Option(help="Start no new configuration after this many seconds.")
    ] = None,
    graphics: Annotated[bool, typer.Option(help="Also measure with off-screen drawing every 10 steps.")] = True,
    repeats: Annotated[int | None, typer.Option(help="Number of samples per configuration.")] = None,
    min_ms: Annotated[
        float | None, typer.Option("--min-ms", help="Shortest duration of a sample in milliseconds.")
    ] = None,
    precision: Precisions = None,
    again: Annotated[bool, typer.Option(help="Repeat samples that were disturbed by other programs.")] = True,
    threads: Annotated[
        list[str] | None, typer.Option(help="Only these CPU threads: 1x, 2x, 4x or a number. Repeatable.")
    ] = None,
    kernels: Annotated[
        bool, typer.Option("--kernels", help="Measure every kernel instead of the automatic choice.")
    ] = False,
    kernel: Annotated[list[str] | None, typer.Option(help="With --kernels: only this kernel. Repeatable.")] = None,
    energy: Annotated[
        bool, typer.Option(help="With --kernels: also measure energy in joules, where the machine can.")
    ] = True,
    starts: Annotated[bool, typer.Option(help="With --kernels: also measure the time to the first step.")] = True,
    peers: Annotated[
        bool,
        typer.Option("--peers", help="Measure other implementations beside it (NumPy, C++, CUDA C++, Warp, Newton)."),
    ] = False,
    scene: Annotated[
        list[str] | None,
        typer.Option(
            help="With --peers only grid, cloth, xpbd, implicit (-16, -4, -1), tetrahedra (-1e5 ...) or rigid (repeatable); "
            "with --gpus: grid, xpbd or xpbd-jacobi."
        ),
    ] = None,
    gpus: Annotated[
        list[int] | None,
        typer.Option(help="Measure a sheet on this many GPUs against one. Repeatable; see also --link."),
    ] = None,
    link: Annotated[list[str] | None, typer.Option(help="With --gpus: flags (default) or nccl. Repeatable.")] = None,
    exchange_every: Annotated[int | None, typer.Option(help="With --gpus: steps between two exchanges.")] = None,
    weak: Annotated[
        bool, typer.Option("--weak", help="With --gpus: N x N masses for each GPU (weak scaling).")
    ] = False,
    cluster: Cluster = None,
    workers: Workers = None,
    sbatch: Sbatch = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Time grid sizes, backends, threads and precisions, with and without graphics. Resumes where it stopped."""
    from softlab.bench.experiments.sweep import THREADS, check_positive, run_sweep
    from softlab.bench.measure.tables import print_kernels, print_sweep

    check_together(peers, kernels, kernel, threads, scene, gpus, cluster, {
        "--weak": weak, "--link": link, "--exchange-every": exchange_every,
    })  # fmt: skip
    check_positive("--min-ms", min_ms)
    where = where_asked(cluster, workers, sbatch)
    if gpus:
        from softlab.bench.experiments.scaling.experiment import SCENES, Scaling

        shared: dict[str, Any] = {"gpus": gpus, "sizes": size, "exchange_every": exchange_every, "weak": weak}
        shared |= {"links": link} if link else {}
        chosen = precisions_of(precision, ["float32"])
        for word in scene or ["grid"]:
            if word not in SCENES:
                raise SceneError("--scene", word, f"with --gpus one of {', '.join(SCENES)}")
            measure(
                store, Scaling(), Scaling().show, quick=quick, backends=backend or ["gpu"], precisions=chosen, scene=word,
                **shared,
            )  # fmt: skip
        return
    how: dict[str, Any] = {
        "quick": quick, "backends": backend, "sizes": size, "max_seconds": max_seconds, "total_seconds": total_seconds,
        "repeats": repeats, "min_seconds": min_ms and min_ms / 1000, "precisions": precisions_of(precision),
        "report": print_sweep,
    }  # fmt: skip
    if kernels:
        from softlab.bench.experiments.kernel_sweep import run_kernel_sweep

        how |= {"kernels": kernel, "energy": energy, "starts": starts, "again": again}
        measure(store, run_kernel_sweep, print_kernels, where=where, **how)
    elif peers:
        run_peers = component("softlab.bench.peers.sweep:run_peers", "--peers")
        measure(store, run_peers, component("softlab.bench.peers.results:print_peers", "--peers"), scenes=scene, **how)
    else:
        measure(store, run_sweep, where=where, graphics=graphics, threads=threads or THREADS, again=again, **how)


def check_together(
    peers: bool,
    kernels: bool,
    kernel: list[str] | None,
    threads: list[str] | None,
    scene: list[str] | None,
    gpus: list[int] | None,
    cluster: str | None,
    shared: Mapping[str, Any],
) -> None:
    """Refuse options of `sweep` that do not go together; `shared`: those of a sheet on several GPUs. Raises SceneError."""
    if peers and (kernels or kernel):
        raise SceneError("--peers", True, "cannot be combined with --kernels and --kernel; leave them out")
    if threads and (peers or kernels):
        raise SceneError("--threads", threads[0], "cannot be combined with --kernels or --peers; leave them out")
    if scene and not (peers or gpus):
        raise SceneError("--scene", scene[0], "applies to --peers or --gpus; add one of them")
    if kernel and not kernels:
        raise SceneError("--kernel", kernel[0], "applies to --kernels; add --kernels")
    if cluster and peers:
        raise SceneError(
            "--cluster",
            cluster,
            "cannot be combined with --peers, which are built on the machine that times them; leave one out",
        )
    for option, value in shared.items():
        if value not in (None, False, []) and not gpus:
            raise SceneError(option, value, "applies to a sheet on several GPUs; add --gpus N")
    for count in gpus or ():
        if count < 1:
            raise SceneError("--gpus", count, "must be at least 1")
    if gpus and (peers or kernels or threads or cluster):
        raise SceneError(
            "--gpus", gpus, "cannot be combined with --peers, --kernels, --threads or --cluster; leave them out"
        )
