"""Claims of the lab book on the hard cases of tetrahedra (B21 to B23); rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.measure.words import count, percent, seconds
from softlab.bench.stress.results import OF_TETRAHEDRA, HardRow, rows_of
from softlab.bench.stress.tetrahedra import OF_FOUR, RATIO, RECOVERY, STORED, STRETCH, VOLUME
from softlab.labbook.claims.claim import Claim, Claims
from softlab.labbook.claims.hard import count_verdicts, measured_value
from softlab.plots.core.data import Results, judgements, needed

CLAIMS = Claims()
SQUASHED = "B22"  # the case of the plates, not of the bar


def _rows(results: Results) -> list[HardRow]:
    return rows_of(judgements(results, lambda measure: measure.description.get("hard", "") in OF_TETRAHEDRA)[0])


def _values(rows: list[HardRow], case: str, name: str) -> list[float]:
    """Return a number of the runs of a case, and of all cases that begin with it and a space."""
    runs = [row for row in rows if row.case == case or row.case.startswith(f"{case} ")]
    return [value for row in runs if (value := measured_value(row, name)) is not None]


@CLAIMS.add("hard-tetrahedra", "The hard cases of tetrahedra were not run.")
def verdicts(results: Results) -> Claim:
    """Number of runs by verdict."""
    return count_verdicts(needed(_rows(results)))


@CLAIMS.add("hard-tetrahedra-laws", "Tetrahedra were not flattened, pressed or poked.")
def laws(results: Results) -> Claim:
    """B21: recovery of shape; B22: loss of volume; B23: no gain of energy with one iteration."""
    rows = _rows(results)
    parts, numbers = list[str](), dict[str, float]()
    ratios, off = _values(rows, "B21", RATIO), _values(rows, "B21", STRETCH)
    if ratios and off:
        numbers |= {"ratio": min(ratios), "stretch": max(off)}
        parts.append(
            f"a cube that was flattened, inverted or given random vertices has within {seconds(RECOVERY, 1)} "
            f"{'every' if min(ratios) > 0 else 'not every'} tetrahedron positively oriented again, stretches within "
            f"{percent(max(off))} of 1, in {count(len(ratios))} runs"
        )
    lost = _values([row for row in rows if row.case == SQUASHED], SQUASHED, VOLUME)
    if lost:
        numbers["volume"] = max(lost)
        parts.append(
            f"a block of Poisson's ratio 0.499 pressed to half of its height loses at most {percent(max(lost))} of its "
            f"volume, of the {percent(OF_FOUR)} that its mesh is allowed"
        )
    most = _values(rows, "B23", STORED)
    if most:
        numbers["energy"] = max(most)
        parts.append(
            f"a stiff bar with one iteration per frame never has more than {percent(max(most))} of the energy it began with"
        )
    text = "; ".join(needed(parts))
    return Claim(f"{text[0].upper()}{text[1:]}.", numbers, all(row.verdict in ("pass", "known") for row in rows))
