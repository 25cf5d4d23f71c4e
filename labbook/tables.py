"""The lab book's tables: titles, column heads with units, and cells as text, made from the results."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from softlab.bench.measure import words
from softlab.bench.store.machine_records import DISTURBED
from softlab.plots.core.data import Results, Source
from softlab.plots.core.style import OLDER

Table = dict[str, Any]  # what `table` returns
DASH = "\N{EN DASH}"
SHORT = 7  # digits of a commit

UNITS = {
    "rows": "masses", "columns": "masses", "spacing": "m", "mass": "kg", "stiffness": "N/m", "rest_length": "m",
    "coefficient": "N s/m", "acceleration": "m/s\u00b2", "magnitude": "N", "dt": "s", "amplitude": "m",
}  # fmt: skip


def table(
    title: str, head: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1, group: int = 0, notes: int = 0
) -> Table:
    """Return a table for the template; its first `left` columns are set flush left, the others flush right.

    The first `group` columns are printed as a line above the rows that they head, the last `notes` as lines below theirs.
    """
    return {
        "title": title, "head": list(head), "rows": [list(row) for row in rows], "left": left, "group": group, "notes": notes
    }  # fmt: skip


def machine_lines(results: Results) -> list[str]:
    """Return one line per machine: its limits, the code and the days of its measurements, and how many are older."""
    return [_machine(source) for source in results.sources]


def _machine(source: Source) -> str:
    record = source.machine.record
    disturbed = ", while other programs ran" if record.get(DISTURBED) else ""
    limits = [
        f"{label} {words.bandwidth(record[name])}"
        for name, label in (("copy_bandwidth", "memory copies"), ("gpu_copy_bandwidth", "of the GPU"))
        if record.get(name)
    ]
    code = re.sub(rf"\b([0-9a-f]{{{SHORT}}})[0-9a-f]+\b", r"\1", f"{source.code}; measured {source.date}")
    copies = f" ({', '.join(limits)}{disturbed})" if limits else ""
    older = re.sub(r" of its (\d+) numbers are older than this code.*", rf" of \1 numbers are {OLDER}", source.older)
    return f"{source.place}{copies}: {code}{older and '; '}{older}."


def scene_line(results: Results) -> str:
    """Return the constants of the scene that was swept, with their units; empty if there was no sweep."""
    source = next((s for s in results.featured if s.scene), None)
    constants = []
    for part, fields in sorted(source.scene.items()) if source else []:
        for name, value in sorted(fields.items()) if isinstance(fields, dict) else []:
            if name != "kind":
                shown = str(value).lower() if isinstance(value, bool) else str(value)
                constants.append(
                    f"{part}.{name} {shown}{words.SPACE}{UNITS[name]}" if name in UNITS else f"{part}.{name} {shown}"
                )
    return f"The scene of the sweep, whose size varies: {', '.join(constants)}." if constants else ""
