"""What `softlab sweep` prints when it is done."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape

from bench.measure_group import SweepSummary


def print_sweep(console: Console, summary: SweepSummary) -> None:
    """What a sweep did, and what it could not do."""
    console.print(
        f"sweep: {summary.measured} configurations measured ({summary.samples} samples, {summary.suspect} suspect), "
        f"{summary.held} already in the store, {summary.seconds:.0f} s of which {summary.compile_seconds:.0f} s compiling"
    )
    reasons: dict[str, int] = {}
    for _, reason in summary.skipped:
        reasons[reason] = reasons.get(reason, 0) + 1
    for reason, count in reasons.items():
        console.print(f"  {count} skipped: {escape(reason)}", soft_wrap=True)
    for configuration, failure in summary.wrong:
        console.print(f"  [red]wrong[/red] {escape(configuration)}: {escape(failure)}", soft_wrap=True)
    if summary.interrupted:
        console.print("  stopped; run it again and it goes on from here")
