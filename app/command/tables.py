"""Tables of the command line (`--json` prints the same for programs)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from softlab.app.command.findings import Finding
from softlab.app.presentation import presentation_of
from softlab.model.scene.fields import about, rows_of
from softlab.model.scene.reader import catalogue
from softlab.model.scene.scene import load_scene

UNITS = {
    "dt": "s",
    "time": "s",
    "seconds": "s",
    "compile_seconds": "s",
    "kinetic_energy": "J",
    "potential_energy": "J",
    "max_speed": "m/s",
    "speed_limit": "m/s",
    "error": "spacings",
    "mean_compression": "of the density at rest",
    "largest_compression": "of the density at rest",
    "height": "m",
    "matrices": "per solve",
    "newton_steps": "per solve",
    "matrix_products": "per solve",
}
LABELS = {
    "mean_compression": "density error, mean", "largest_compression": "density error, largest",
    "newton_steps": "Newton steps",
}  # fmt: skip
MODIFIED = "J (2 x kinetic + potential, which the step lab {keeps})"
IN_NOTES = ("built", "error_reason", "resolution", "waiting", "waiting_particles")  # not on a line of their own
HIDDEN_IF_NONE = ("error", "threads_reason", "max_strain")  # no line without a value


def number(value: object) -> str:
    """Return a value in a form for people."""
    if isinstance(value, bool) or value is None:
        return "-" if value is None else str(value)
    if isinstance(value, int):
        return f"{value:,}".replace(",", " ")
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value)


def print_report(console: Console, report: Mapping[str, Any], written: list[Path], keeps: str = "conserves") -> None:
    """Print the result of one run. `keeps`: a clause on the energy that its step conserves (model/core/energy.py)."""
    table = Table(show_header=False, box=None, pad_edge=False)
    waiting = {"particles": report.get("waiting_particles"), "bodies": report.get("waiting")}
    for key, value in report.items():
        if key in IN_NOTES or (key in HIDDEN_IF_NONE and value is None):
            continue
        label, unit = LABELS.get(key, key.replace("_", " ")), UNITS.get(key, "")
        if key == "max_strain" and "bodies" in report:
            unit = "spacings, distance from goal"
        elif key == "conserved":
            modified = value != report["kinetic_energy"] + report["potential_energy"]
            label, unit = ("modified energy", MODIFIED.format(keeps=keeps)) if modified else ("total energy", "J")
        more = f"+ {number(waiting[key])} inactive" if waiting.get(key) else ""
        table.add_row(label, f"{number(value)} {unit}{more}".rstrip())
    if report["error_reason"]:
        label = "error" if report["error"] is None else ""
        table.add_row(label, ("not available: " if report["error"] is None else "") + escape(report["error_reason"]))
    console.print(table)
    for path in written:
        console.print(f"wrote {path}", markup=False)


def print_scenes(console: Console) -> None:
    """Print the catalogue."""
    columns = [Column(head, overflow="fold") for head in ("scene", "what it is", "masses", "method")]
    table = Table(*columns, box=None, pad_edge=False, collapse_padding=True)
    for name in catalogue():
        scene = load_scene(name)
        table.add_row(name, escape(scene.title), presentation_of(scene).size(scene), scene.method.name)
    console.print(table)


def print_fields(console: Console, kind: str) -> None:
    """Print the fields of a table of a scene file: three columns, since a fourth does not fit on a narrow terminal.
    Raises SceneError."""
    heads = (
        Column("field", no_wrap=True),
        Column("default", overflow="fold"),
        Column("allowed, meaning", overflow="fold"),
    )
    table = Table(*heads, box=None, pad_edge=False)
    for row in rows_of(kind):
        table.add_row(
            row.name, escape(row.default), escape("; ".join(text for text in (row.allowed, row.note) if text))
        )
    console.print(f"[{kind}]: {about(kind)}\n", markup=False)
    console.print(table)


def print_findings(console: Console, findings: list[Finding]) -> None:
    """Print the doctor's report: one line per finding, with the remedy below it, if any."""
    for finding in findings:
        mark = "[green]yes[/green]" if finding.works else "[yellow]no [/yellow]"
        console.print(f"{mark}  [bold]{finding.name}[/bold]: {escape(finding.detail)}", soft_wrap=True)
        if finding.remedy:
            console.print(f"     -> {escape(finding.remedy)}", soft_wrap=True)
