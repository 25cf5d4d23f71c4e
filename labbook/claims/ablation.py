"""Claim of the lab book on the parts that scenes need (`softlab ablate`); rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.experiments.advise.ablation_results import NOT_NEEDED
from softlab.bench.measure.words import count, listed, times
from softlab.labbook.claims.claim import Claim, Claims
from softlab.plots.core.data import Results, needed
from softlab.plots.figures.ablation import quotable_tables

CLAIMS = Claims()


@CLAIMS.add("ablation-idle", "Nothing was left out of a scene.")
def idle(results: Results) -> Claim:
    """Number and names of the things that a scene does not need, and the most time that one of them saves."""
    source, tables = quotable_tables(results)
    rows = needed([(table, row) for table in tables for row in table.rows])
    idle = [(table, row) for table, row in rows if table.verdict(row) == NOT_NEEDED]
    numbers = {"rows": float(len(rows)), "spare": float(len(idle))}
    text = f"Of {count(len(rows))} things left out one at a time, {count(len(idle))} changed less than the method's own error"
    if idle:
        text += f" ({listed(list(dict.fromkeys(row.name for _, row in idle)))})"
    savings = [saving for table, row in idle if (saving := table.quotable_saving(row)) is not None]
    if savings:
        numbers["most"] = max(savings)
        text += f"; the best of them made a run {times(max(savings))} as fast on the {needed(source).place}"
    return Claim(f"{text}.", numbers, True)
