"""Which rows a law is asked of, in which cases and labs, and what of it runs by default."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

from lab import Lab
from law import LAWS, Law
from rows import ALL, Row

PRECISIONS = ("float64", "float32")


@cache
def asked(law: Law) -> list[tuple[Row, str]]:
    """The rows that the law applies to, each in all its cases."""
    return [(row, case) for row in ALL if not law.absent(row) for case in law.cases(row)]


@cache
def by_default(law: Law) -> dict[tuple[Row, str], None]:
    """Of each family one row, another one for each law, so that all laws together ask all rows; and every case once."""
    number = LAWS.index(law)
    chosen: dict[tuple[Row, str], None] = {}
    families: dict[str, list[tuple[Row, str]]] = {}
    for row, case in asked(law):
        families.setdefault(row.family, []).append((row, case))
    for place, pairs in enumerate(families.values()):
        rows = list(dict.fromkeys(row for row, _ in pairs))
        row = rows[number % len(rows)]
        cases = [case for one, case in pairs if one is row]
        chosen[row, cases[(place + number) % len(cases)]] = None
    for row, case in asked(law):
        if case not in {one for _, one in chosen}:
            chosen[row, case] = None
    if number == 1:  # the second law, which applies to all: rows that no other law asks of
        others = {row for law in LAWS if law is not LAWS[1] for row, _ in by_default(law)}
        chosen |= {(row, law.cases(row)[0]): None for row in ALL if row not in others and not law.absent(row)}
    return chosen


def labs(law: Law, row: Row, case: str, chosen: bool) -> Iterator[tuple[Lab, bool]]:
    """Where a law asks a row in a case, and whether by default. On the CPU a law of one case asks in both precisions, one of
    several in each by turns (what is `chosen` by default in one of them); on a GPU each row is asked in one case and
    precision, and in fast math where it is chosen."""
    known, cases = PRECISIONS if law.resolved else PRECISIONS[:1], law.cases(row)
    place, number = ALL.index(row) + LAWS.index(law), cases.index(case)
    turn = (place + number) % len(known)
    for one, precision in enumerate(known):
        if one == turn or len(cases) == 1:
            yield Lab("cpu", precision), chosen and one == turn
    if number == place % len(cases):
        yield Lab("gpu", known[turn]), True
    if chosen and law.precise:
        yield Lab("gpu", "float32" if law.resolved else "float64", "fast"), True
