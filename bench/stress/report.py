"""Table of the verdicts of the hard cases, and failures with reasons, for the terminal and for figures."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from softlab.bench.stress.results import (
    CODES,
    NAMES,
    STYLES,
    WORDS,
    HardRow,
    HardSummary,
    disagreements,
    rounding_differences,
)


def cell(rows: Sequence[HardRow]) -> tuple[str, str]:
    """Return (verdict, text) of one case and integrator over all backends and precisions.

    It is the worst verdict, with the precisions or backends that have it, unless all do.
    """
    for verdict in ("fail", "known", "refused", "pass"):
        selected = [row for row in rows if row.verdict == verdict]
        if selected and len(selected) == len(rows):
            return verdict, WORDS[verdict]
        if selected:
            precisions = sorted({row.precision for row in selected})
            backends = sorted({row.backend for row in selected})
            some = len(precisions) < len({row.precision for row in rows})
            return verdict, f"{WORDS[verdict]} {'in' if some else 'on'} {', '.join(precisions if some else backends)}"
    return "", ""


def table_of(rows: Sequence[HardRow]) -> tuple[list[str], list[tuple[str, str, str, list[tuple[str, str]]]]]:
    """Return (integrators, lines) of the verdict table; a line: case, title, decisive check, a `cell` per integrator."""
    names = [name for name in NAMES if any(row.integrator == name for row in rows)]
    lines = []
    for case in dict.fromkeys(row.case for row in rows):
        case_rows = [row for row in rows if row.case == case]
        cells = [cell([row for row in case_rows if row.integrator == name]) for name in names]
        lines.append((case, case_rows[0].title, _lead(case_rows), cells))
    return names, lines


def _lead(rows: Sequence[HardRow]) -> str:
    """Return the decisive check of a case with its bound, and the worst value in float64 of the runs that passed."""
    judged = [r for r in rows if r.checks and r.checks[0].value is not None and r.verdict in ("pass", "refused")]
    judged = [r for r in judged if r.precision == "float64"] or judged
    if not judged:
        return ""
    bound = judged[0].checks[0].bound
    pick = min if bound.startswith(">") else max
    return str(pick((r.checks[0] for r in judged), key=lambda check: check.value or 0.0))


def _print_table(console: Console, rows: Sequence[HardRow]) -> None:
    names, lines = table_of(rows)
    table = Table("case", "what", Column("measured, worst in float64 (bound)", max_width=44), *names, box=None)
    for case, title, lead, cells in lines:
        shown = [f"[{STYLES[verdict]}]{text}[/]" if verdict else "-" for verdict, text in cells]
        table.add_row(case, title, escape(lead), *shown)
    if rows:
        console.print(table)


def print_hard(console: Console, summary: HardSummary) -> None:
    """Print the verdict table, failures with reasons, and differences between backends."""
    rows = summary.rows
    for kind in ("sheet", "body", "tetrahedra", "fluid"):
        _print_table(console, [row for row in rows if row.kind == kind])
    for verdict, heading in (("known", "fails by its method"), ("refused", "refused")):
        cases_by_reason: dict[str, list[str]] = {}
        for row in rows:
            if row.verdict == verdict:
                cases_by_reason.setdefault(row.diagnosis, []).append(f"{row.case} {row.integrator}")
        for diagnosis, where in cases_by_reason.items():
            console.print(f"{heading}: {', '.join(dict.fromkeys(where))}: {diagnosis}", markup=False, soft_wrap=True)
    for row in rows:
        if row.verdict == "fail":
            console.print(f"FAIL, a bug of the lab: {row}: {row.diagnosis}", markup=False, soft_wrap=True, style="red")
    missed = {(row.case, row.backend): str(check) for row in rows if row.verdict == "pass"
              for check in row.checks if check.over_aim}  # fmt: skip
    for (case, backend), text in missed.items():
        console.print(
            f"passed, but short of the target: {case} on the {backend}: {text}",
            markup=False,
            soft_wrap=True,
            style="yellow",
        )
    for text in disagreements(rows):
        console.print(f"backends differ, a bug of the lab: {text}", markup=False, soft_wrap=True, style="red")
    for text in rounding_differences(rows):
        console.print(f"rounding shows on one backend alone: {text}", markup=False, soft_wrap=True, style="yellow")
    if not rows:
        console.print(
            "none of the chosen cases is run by the chosen methods; softlab hard --help names both", markup=False
        )
    counts = {verdict: sum(row.verdict == verdict for row in rows) for verdict in CODES}
    console.print(
        f"hard cases: {len(rows)} runs: {counts['pass']} passed, {counts['refused']} refused with a diagnosis, "
        f"{counts['known']} failed by their method, {counts['fail']} failed; {summary.counts('run now')}{summary.ending()}"
    )
    if summary.no_pictures:
        console.print(f"no pictures: {summary.no_pictures}", markup=False, soft_wrap=True)
