"""Claims of the lab book on the parts that scenes need (`softlab ablate`); rules in labbook/claims/claim.py."""

from __future__ import annotations

import re

from softlab.bench.experiments.advise.ablation_results import NEEDED, NOT_NEEDED
from softlab.labbook.claims.claim import Claim, Claims
from softlab.labbook.words import count, number
from softlab.plots.core.data import Results
from softlab.plots.figures.ablation import told_tables


def typeset(sentence: str) -> str:
    """Return a sentence of the terminal as the book prints it: 5.4e-04 as a power of ten."""
    return re.sub(r"\b\d\.\de[+-]\d\d\b", lambda found: number(float(found[0]), 2), sentence)


def needs(results: Results) -> Claim:
    """One sentence per scene and backend: the parts that it needs, and the settings that are enough."""
    source, tables = told_tables(results)
    if source is None or not tables:
        return Claim("What the scenes need was not measured.")
    numbers: dict[str, float] = {}
    for table in tables:
        verdicts = [table.verdict(row) for row in table.rows]
        name = f"{table.title}, {table.backend}"
        numbers |= {f"{name}: {verdict}": float(verdicts.count(verdict)) for verdict in (NEEDED, NOT_NEEDED)}
    told = " ".join(typeset(table.sentence()) for table in tables)
    return Claim(f"On the {source.place}: {told}", numbers, True)


def idle(results: Results) -> Claim:
    """Number of ablated parts and settings that were not needed."""
    _, tables = told_tables(results)
    rows = [(table, row) for table in tables for row in table.rows]
    if not rows:
        return Claim("Nothing was left out of a scene.")
    spare = sum(table.verdict(row) == NOT_NEEDED for table, row in rows)
    text = f"Of {count(len(rows))} things that were left out, {count(spare)} changed less than the method's own error."
    return Claim(text, {"rows": float(len(rows)), "spare": float(spare)}, True)


CLAIMS: Claims = {"ablation-needs": needs, "ablation-idle": idle}
