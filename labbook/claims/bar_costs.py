"""Claims of the lab book on the time of one bar by every method (`softlab bar`); rules in labbook/claims/claim.py."""

from __future__ import annotations

import re

from softlab.bench.experiments.bar_costs import CLOSE, Cost
from softlab.bench.measure import words
from softlab.labbook.claims.bodies import substeps_of
from softlab.labbook.claims.claim import SUSPECT, Claim, Claims, where
from softlab.plots.core.backends import on_backends
from softlab.plots.core.data import Results, needed
from softlab.plots.figures.bar_costs import on

CLAIMS = Claims()


@CLAIMS.add("bar-costs", "The cost of the bar by each method was not measured.")
def costs_of(results: Results) -> Claim:
    """Time of a frame of each method that is CLOSE to the rod, at the fewest such substeps; and the methods that never
    are.
    """
    parts, numbers, busy = list[str](), dict[str, float](), False
    for backend, source, costs in on_backends(results, on):
        near: dict[str, Cost] = {}
        for cost in sorted((c for c in costs if c.close), key=lambda c: c.frame):
            near.setdefault(cost.solver, cost)
        if near:
            numbers |= {f"{backend} {name}": cost.frame for name, cost in near.items()}
            times = [f"{words.seconds(cost.frame)} ({name}, {substeps_of(cost)})" for name, cost in near.items()]
            parts.append(f"on {where(backend, source)} {words.listed(times)}")
            busy = busy or any(cost.suspect for cost in near.values())
            judged = {c.solver for c in costs if None not in (c.sag, c.frequency)}
            never = [name for name in dict.fromkeys(c.solver for c in costs) if name in judged - near.keys()]
            if never:
                parts[-1] += f"; {_named(never)} {'is' if len(never) == 1 else 'are'} not so near"
            timed = [name for name in dict.fromkeys(c.solver for c in costs) if name not in judged]
            if timed:
                parts[-1] += f"; of {_named(timed)} the time alone was measured"
    frames = f"{'; '.join(needed(parts))}{SUSPECT if busy else ''}"
    text = f"Where sag and frequency are within {words.percent(CLOSE)} of the rod's, a frame takes {frames}."
    return Claim(text, numbers, True)


def _named(solvers: list[str]) -> str:
    """Return e.g. `tetrahedra (newton) and xpbd`, so that commas only separate methods."""
    return words.listed([re.sub(r"^(.*), (.*)$", r"\1 (\2)", name) for name in solvers])
