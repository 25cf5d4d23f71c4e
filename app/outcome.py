"""Outcome of a run (ok, incomplete, diverged), and sentences about its faults with remedies."""

from __future__ import annotations

from collections.abc import Mapping

from softlab.model.base.errors import Diverged
from softlab.model.contact.shortfalls import CAUGHT, FAULTS

OK, INCOMPLETE, DIVERGED = "ok", "incomplete", "diverged"


def outcome_of(report: Mapping[str, object], diverged: Diverged | None = None) -> str:
    """Return the outcome of a run as one word. `report` contains the counts of FAULTS that apply to its scene."""
    if diverged is not None:
        return DIVERGED
    return INCOMPLETE if any(report.get(name) for name in FAULTS) else OK


def fault_lines(report: Mapping[str, object]) -> list[str]:
    """Return a sentence for each fault of a run: the fault, its size, and the remedy."""
    lines = []
    if lost := report.get("contacts_lost"):
        lines.append(
            f"{lost} contacts did not fit into the lists of their particles and had no effect: the bodies are "
            "compressed too much; more substeps, a smaller contact distance or radius, or a larger separation_speed help"
        )
    if lost := report.get("neighbours_lost"):
        lines.append(
            f"{lost} neighbours did not fit into the lists of their particles: the fluid is compressed too "
            "much; more substeps "
            "or iterations, or a smaller support, help"
        )
    if inverted := report.get("inverted"):
        lines.append(
            f"{inverted} tetrahedra are inverted at the end; more substeps or iterations, the solver newton, or a stiffer "
            "material help"
        )
    if caught := report.get("caught"):
        nearest = report.get("least_distance")
        where = (
            f"particles are nearer than {CAUGHT:g} of what contacts keep, the nearest at {nearest:.2f}"
            if nearest is not None
            else "vertices lie inside another body"
        )
        lines.append(
            f"bodies overlap: {caught} {where}; more substeps, stiffer bodies, a larger "
            "contact.separation_speed or contact.sweeps, or a contact.maximum_speed of an eighth of the distance a substep "
            "help"
        )
    return lines


def fault_words(report: Mapping[str, object]) -> str:
    """Return the faults of a run in a few words: `3 contacts lost, 13 inverted`."""
    counts = {name: report.get(name) or 0 for name in FAULTS}
    return ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items() if count)
