"""Tables that `softlab sweep` and `softlab lab` print when they are done."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from softlab.bench.measure.cases import LADDER, SweepSummary
from softlab.bench.store.database import Store
from softlab.bench.store.marks import is_wrong
from softlab.bench.store.results import timings


def print_table(
    console: Console,
    heads: Iterable[Column | str],
    rows: Iterable[Iterable[str]],
    below: str = "",
    title: str | None = None,
) -> None:
    """Print a table without borders, and the text `below` it."""
    table = Table(*heads, box=None, title=title, title_justify="left")
    for row in rows:
        table.add_row(*row)
    console.print(table)
    if below:
        console.print(below, soft_wrap=True)


def columns(words: Iterable[str], numbers: Iterable[str]) -> list[Column]:
    """Return headers of columns: first of words that are never broken, then of right-aligned numbers."""
    return [*(Column(name, no_wrap=True) for name in words), *(Column(name, justify="right") for name in numbers)]


def print_sweep(console: Console, summary: SweepSummary) -> None:
    """Print the results of a sweep, and the cases that could not run."""
    console.print(
        f"sweep: {summary.measured} configurations measured ({summary.samples} samples, {summary.suspect} suspect), "
        f"{summary.stored} already in the store, {summary.seconds:.0f} s of which {summary.compile_seconds:.0f} s compiling"
    )
    reasons: dict[str, int] = {}
    for _, reason in summary.skipped:
        reasons[reason] = reasons.get(reason, 0) + 1
    for reason, count in reasons.items():
        console.print(f"  {count} skipped: {escape(reason)}", soft_wrap=True)
    for configuration, failure in summary.wrong:
        console.print(f"  [red]wrong[/red] {escape(configuration)}: {escape(failure)}", soft_wrap=True)
    if summary.samples and summary.suspect > summary.samples / 2:
        console.print(
            "  [yellow]most samples are suspect: this machine is busy.[/yellow] For numbers to rely on, close other "
            "programs, move the store away and run it again",
            soft_wrap=True,
        )
    if any("used up" in reason for _, reason in summary.skipped):
        console.print("  run it again to measure what was left out")
    if summary.interrupted:
        console.print("  stopped; run it again to resume")


def _short(seconds: float) -> str:
    """Microseconds in three digits or whole ones."""
    value = seconds * 1e6
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def print_fastest(console: Console, store: Store, machine: str) -> None:
    """Time per step and its spread for every size, backend and thread count that was measured here, in float32."""
    rows: dict[tuple[int, int], dict[str, str]] = {}
    heads: list[str] = []
    for timing in sorted(timings(store, machine), key=lambda t: (t.backend, t.threads or 0)):
        if timing.graphics or timing.precision != "float32" or timing.peer or not timing.chosen:
            continue
        head = "gpu" if timing.backend == "gpu" else f"cpu {timing.thread_word}"
        if head not in heads:
            heads.append(head)
        mark = "?" if timing.suspect else ""
        cell = f"{_short(timing.median)} ({_short(timing.low)} to {_short(timing.high)}){mark}"
        rows.setdefault((timing.rows, timing.columns), {})[head] = cell
    table = Table("masses", *heads, box=None, title="microseconds a step, float32, without graphics: median (range)")
    for (height, width), cells in sorted(rows.items(), key=lambda item: item[0][0] * item[0][1]):
        table.add_row(f"{height} x {width}", *(cells.get(head, "-") for head in heads))
    console.print(table)
    if any("?" in cell for cells in rows.values() for cell in cells.values()):
        console.print("?: suspect, see docs/method/time.md")


def print_kernels(console: Console, store: Store, machine: str) -> None:
    """Time per step of every forced kernel and size, a table for each backend and precision, the best in bold."""
    forced = [t for t in timings(store, machine) if not (t.chosen or t.graphics or t.peer)]
    suspect = False
    for key in sorted({(t.backend, t.precision, t.thread_word or "") for t in forced}):
        group = [t for t in forced if (t.backend, t.precision, t.thread_word or "") == key]
        names = sorted({t.kernel for t in group}, key=lambda name: (LADDER.index(name) if name in LADDER else 99, name))
        words = " ".join(filter(None, (key[0], key[2], key[1])))
        console.print(f"{words}: microseconds a step, median (spread of the repeats)")
        table = Table("masses", *names, box=None)
        for shape in dict.fromkeys((t.rows, t.columns) for t in group):
            here = {t.kernel: t for t in group if (t.rows, t.columns) == shape}
            right = [t for t in here.values() if not any(map(is_wrong, t.suspect))]
            best = min(right, key=lambda t: t.median, default=None)
            cells = {}
            for name, t in here.items():
                mark = "?" if t.suspect else ""
                suspect = suspect or bool(mark)
                text = f"{_short(t.median)} ({t.spread:.0%}){mark}"
                cells[name] = f"[bold green]{text} *[/]" if t is best else text
            table.add_row(f"{shape[0]} x {shape[1]}", *(cells.get(name, "-") for name in names))
        console.print(table)
    if forced:
        console.print("*: the fastest" + (";  ?: suspect, see docs/method/time.md" if suspect else ""))
