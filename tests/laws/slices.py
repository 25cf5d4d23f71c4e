"""Which rows a law is asked of, in which cases and labs, and what of it runs by default."""

from __future__ import annotations

from collections.abc import Iterator

from lab import Lab
from law import LAWS, Law
from rows import ALL, Row

PRECISIONS = ("float64", "float32")


def asked(law: Law) -> list[tuple[Row, str]]:
    """The rows that the law applies to, each in all its cases."""
    return [(row, case) for row in ALL if not law.absent(row) for case in law.cases(row)]


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


def labs(law: Law, place: int, chosen: bool) -> Iterator[tuple[Lab, bool]]:
    """Where a law asks its pair number `place`, and whether by default: on the CPU in both precisions, of which one comes by
    default where the pair is `chosen`; on a GPU in one of them, and in fast math where it is chosen."""
    known = PRECISIONS if law.resolved else PRECISIONS[:1]
    for number, precision in enumerate(known):
        yield Lab("cpu", precision), chosen and number == place % len(known)
    yield Lab("gpu", known[place % len(known)]), True
    if chosen and law.precise:
        yield Lab("gpu", known[place % len(known)], "fast"), True
