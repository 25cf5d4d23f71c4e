"""Which variants of a test run: few that together show every value, or every pair of values, of its parameters."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from itertools import combinations

Case = Mapping[str, Hashable]  # parameter -> value


def shown(case: Case, together: int) -> set[tuple]:
    """The values of a case, `together` at a time (all of them, if it has no more parameters)."""
    return set(combinations(sorted(case.items(), key=lambda item: item[0]), min(together, len(case))))


def covering(cases: Sequence[Case], together: int = 1, known: Sequence[Case] = ()) -> list[int]:
    """Places of cases, in order, that show what all of them do: every value (1), every pair of values that occurs (2).
    What the `known` cases show is not shown again.

    Greedy: the case that adds most comes next; of equals the one with the most new pairs, then the first.
    """
    wanted = [shown(case, together) for case in cases]
    pairs = [shown(case, 2) for case in cases]
    missing: set = set().union(*wanted).difference(*(shown(case, together) for case in known))
    new: set = set().union(*pairs)
    chosen = []
    while missing:
        best = max(range(len(cases)), key=lambda k: (len(wanted[k] & missing), len(pairs[k] & new), -k))
        chosen.append(best)
        missing -= wanted[best]
        new -= pairs[best]
    return sorted(chosen)
