"""`softlab scale`: predictions for many GPUs, by the model of bench/experiments/scaling/model.py."""

from __future__ import annotations

from typing import Annotated

import typer

from softlab.app.command.command_line import DEFAULT_STORE, StorePath, out
from softlab.model.base.errors import SceneError

scaling = typer.Typer()


@scaling.command(epilog="Example: softlab scale --gpus 1000   (another network: --bandwidth 25 --latency 20)")
def scale(
    gpus: Annotated[int, typer.Option(help="Largest number of GPUs; doubled from 1.")] = 1000,
    size: Annotated[
        int,
        typer.Option(
            help="Masses along each side of the grid (strong scaling) and of the part of each GPU (weak scaling)."
        ),
    ] = 16384,
    exchange_every: Annotated[
        int | None, typer.Option(help="Steps between two exchanges of borders (default: automatic).")
    ] = None,
    per_host: Annotated[int, typer.Option(help="GPUs per host, connected by NVLink.")] = 8,
    latency: Annotated[float, typer.Option(help="Latency of the network between hosts in microseconds.")] = 10.0,
    bandwidth: Annotated[float, typer.Option(help="Bandwidth of the network per GPU in GB/s.")] = 50.0,
    jitter: Annotated[float, typer.Option(help="Random delay of a cycle, relative to its duration.")] = 0.01,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Predict strong and weak scaling of a grid on many GPUs, and compare the model with measurements."""
    from softlab.bench.experiments.scaling.model import Cluster
    from softlab.bench.experiments.scaling.report import MOST, print_checked, print_predicted
    from softlab.model.domains.link import Link

    for option, value, least, most in (
        ("--gpus", gpus, 1, MOST),
        ("--size", size, 2, 1 << 20),
        ("--exchange-every", exchange_every, 1, 1 << 20),
        ("--per-host", per_host, 1, MOST),
        ("--latency", latency, 0, 1e9),
        ("--bandwidth", bandwidth, 1e-9, 1e9),
        ("--jitter", jitter, 0, 1e3),
    ):
        if value is not None and not least <= value <= most:
            raise SceneError(option, value, f"must be a number from {least} to {most:.10g}")
    asked = Link("network", 1e-6 * latency, 1e9 * bandwidth, "from the command line")
    cluster = Cluster(per_host=per_host, across=asked, jitter=jitter)
    print_predicted(out, gpus, size, cluster, exchange_every)
    print_checked(out, store)
