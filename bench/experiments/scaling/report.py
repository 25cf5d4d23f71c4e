"""Tables of `softlab scale`."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from softlab.app.command.tables import number
from softlab.bench.experiments.scaling.experiment import Scaling, speedups
from softlab.bench.experiments.scaling.model import (
    Cluster,
    Predicted,
    Seconds,
    predicted,
    restart,
    waiting,
    window_seconds,
)
from softlab.bench.measure.tables import print_table
from softlab.bench.store.results import measures, open_readonly
from softlab.model.base.errors import SceneError

HEADS = "GPUs", "rows each", "every", "step / us", "exchange", "waiting", "T masses / s", "x one", "of ideal"
MOST = 16_384  # GPUs: with more, each line takes seconds


def counts(most: int) -> list[int]:
    """Return 1, 2, 4 ... and `most`. Raises SceneError."""
    if most < 1:
        raise SceneError("--gpus", most, "must be at least 1")
    return sorted({*(1 << k for k in range(most.bit_length())), most})


def table(
    size: int, most: int, cluster: Cluster, every: int | None, weak: bool, seconds: Seconds = window_seconds
) -> list[tuple[int, Predicted, float]]:
    """Return (GPUs, prediction, fraction of ideal) of a grid of size x size, or of one such grid per GPU (`weak`).

    Grids of several GPUs are stacked. The list ends where there are too few rows. Raises SceneError if two GPUs have
    too few for that exchange interval.
    """
    rows = []
    one = predicted(size, size, 1, cluster, seconds=seconds)
    for count in counts(most):
        try:
            many = predicted(size * (count if weak else 1), size, count, cluster, every, seconds)
        except SceneError:
            if every is not None and count == 2:
                raise
            break
        rows.append((count, many, many.rate / one.rate / count))
    return rows


def print_predicted(console: Console, most: int, size: int, cluster: Cluster, every: int | None) -> None:
    """Print strong and weak scaling and the cost of failures. Raises SceneError if the grid has fewer than 2 rows."""
    if size < 2:
        raise SceneError("--size", size, "must be at least 2")
    rows: list[tuple[int, Predicted, float]] = []
    titles = (False, f"{size} x {size} masses"), (True, f"{size} x {size} masses for each GPU, one share below another")
    for weak, title in titles:
        rows = table(size, most, cluster, every, weak)
        cells = [
            (
                str(count), str(p.decomposition.least_rows), str(p.decomposition.steps),
                f"{1e6 * p.step:.4g}", f"{100 * p.exchange / p.step:.2g} %", f"{100 * p.waiting / p.step:.2g} %",
                f"{p.rate / 1e12:.3g}", f"{efficiency * count:.4g}", f"{100 * efficiency:.3g} %",
            )
            for count, p, efficiency in rows
        ]  # fmt: skip
        print_table(console, HEADS, cells, f"{title}, float32, by the model\n")
    count, p, _ = rows[-1]
    if count == 1:
        return
    cost, cut = restart(p.decomposition.rows * size, count, cluster), p.decomposition
    console.print(
        f"files to restart from, on {count} GPUs: {cost.write:.3g} s to write, a failure every {cost.life / 3600:.3g} h, "
        f"so one every {cost.interval / 60:.3g} min; {100 * cost.lost:.2g} % of the time is lost",
        soft_wrap=True,
    )
    cycle, exchange = p.compute * cut.steps, p.exchange * cut.steps
    slow = waiting(count, cycle, exchange, cluster.jitter, together=True) / waiting(
        count, cycle, exchange, cluster.jitter
    )
    console.print(
        f"were all to wait for all at every exchange, a step would take {slow:.3f} times as long", soft_wrap=True
    )


def print_checked(console: Console, store: Path) -> None:
    """Print the model's speed-ups and errors against those in the store."""
    if not store.exists():
        console.print("nothing was measured here yet: softlab sweep --gpus 1 --gpus 2 measures", soft_wrap=True)
        return
    with open_readonly(store) as opened:
        compared = speedups(Scaling().rows(measures(opened)))
    rows = [
        (
            f"{p.rows} x {p.columns}", str(p.gpus), p.link, f"{faster:.3f}", f"{model:.3f}",
            f"{100 * (model / faster - 1):+.1f} %",
        )
        for p, faster, model in compared
        if model is not None
    ]  # fmt: skip
    if not rows:
        console.print("no grid was measured on several GPUs: softlab sweep --gpus 1 --gpus 2", soft_wrap=True)
        return
    heads = "grid", "GPUs", "link", "x one, measured", "by the model", "error"
    print_table(console, heads, rows, f"the model against {number(len(rows))} measured")
