"""The range of masses that decide a mass's position after some iterations: pure arithmetic, for tiles and for windows.

A mass depends on those that its constraints reach, colour by colour backwards. Colours alternate every 2 or 4 masses,
so that the starting row matters: with all twelve families an iteration reaches 4 rows beyond a row whose number is a
multiple of 4 plus 2, and 6 beyond a multiple of 4; either ends at a multiple of 4 plus 2, so that further ones reach 4.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

from softlab.model.position_based.plan import Family, colour_order, families

PERIOD = 4  # colours repeat after this number of masses along either axis


def partners(family: Family, colour: int, along_rows: bool, place: int) -> tuple[int, ...]:
    """Return the positions along an axis that the constraints of a colour connect with a mass at `place`.

    Diagonals lead in both directions along the columns, depending on the row.
    """
    stride = family.rows if along_rows else abs(family.columns)
    if stride == 0:
        return ()
    if not along_rows and family.rows:
        return place - stride, place + stride
    first = (place // stride) % 2 == colour
    return (place + stride,) if first else (place - stride,)


def dependencies(parts: frozenset[str], along_rows: bool, first: int, end: int, iterations: int = 1) -> tuple[int, int]:
    """Return (first, end) of the masses along an axis on which the masses first ... end - 1 depend after `iterations`
    of all colours."""
    if "gauss-seidel" not in parts:
        stencil = max((max(f.rows, abs(f.columns)) for f in families(parts)), default=0)
        return first - stencil * iterations, end + stencil * iterations
    for _ in range(iterations):
        for family, colour in reversed(colour_order(parts)):
            others = [
                other
                for place in {*range(first, min(first + 4, end)), *range(max(first, end - 4), end)}
                for other in partners(family, colour, along_rows, place)
            ]
            first, end = min([first, *others]), max([end, *(place + 1 for place in others)])
    return first, end


def period(parts: frozenset[str]) -> int:
    """Return the rows after which constraints repeat: colours, and alternating springs."""
    if "gauss-seidel" in parts:
        return PERIOD if "bending" in parts else 2
    return 2 if "alternating" in parts else 1


@cache
def substep_rows(parts: frozenset[str], iterations: int) -> tuple[int, int]:
    """Return (rows, more): n substeps read rows * n + more beyond rows that begin and end at multiples of `period`.

    Wind reads the rows beside a mass at a substep's start. In the Jacobi orderings the denominator of a mass depends on
    its constraints, which adds their extent once more.
    """
    wind, edges = int("wind" in parts), [(0, 4 * PERIOD)]
    for _ in range(2 * PERIOD):  # after this number an edge returns to an earlier place in the period
        first, end = dependencies(parts, True, *edges[-1], iterations)
        edges.append((first - wind, end + wind))
    sides = [-first for first, _ in edges], [end - edges[0][1] for _, end in edges]
    rows = max(later - now for extent in sides for now, later in pairwise(extent[1:]))
    more = max(far - rows * number for extent in sides for number, far in enumerate(extent))
    return rows, more if "gauss-seidel" in parts else more + max((family.rows for family in families(parts)), default=0)
