"""Claims of the lab book on laws of bodies (`softlab bar`); rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.experiments.bar_rows import Bar
from softlab.bench.experiments.body_laws import (
    ANGULAR_MOMENTUM,
    DROP,
    ENERGY,
    FLIGHT,
    MOMENTUM,
    SECONDS,
    SPIN,
    SPIN_LAW,
    STILL,
)
from softlab.bench.measure import words
from softlab.bench.measure.words import number, percent, seconds
from softlab.labbook.claims.bodies import EQUAL, measured_bars, substeps_of
from softlab.labbook.claims.claim import Claim, Claims
from softlab.plots.core.data import Results, needed

CLAIMS = Claims()


def _laws(results: Results, law: str, names: set[str]) -> list[Bar]:
    """Return the float64 rows of a law with measures of these names, by substeps. Raises NotMeasured."""
    rows = [b for b in measured_bars(results) if b.law == law and b.precision == "float64" and names <= {*b.values}]
    return sorted(needed(rows), key=lambda b: b.substeps)


@CLAIMS.add("body-spin", "The spin of a rigid body was not measured.")
def spin(results: Results) -> Claim:
    """S7 and A8: loss of spin of a rigid body, compared with its law."""
    rows = _laws(results, SPIN, {ANGULAR_MOMENTUM, SPIN_LAW})
    off = max(abs(bar.values[ANGULAR_MOMENTUM] - bar.values[SPIN_LAW]) for bar in rows)
    parts = [f"{percent(bar.values[ANGULAR_MOMENTUM])} at {substeps_of(bar)} a frame" for bar in rows]
    return Claim(
        f"A rigid body that turns once a second keeps, after {seconds(SECONDS[SPIN], 1)}, {words.listed(parts)} of its spin. "
        f"Newton's law conserves all of it; the loss agrees with the law of the method to {number(off, 1)}.",
        {"off": off, "kept": rows[-1].values[ANGULAR_MOMENTUM]}, off < EQUAL,
    )  # fmt: skip


@CLAIMS.add("body-flight", "The momenta of a thrown soft body were not measured.")
def flight(results: Results) -> Claim:
    """Linear and angular momentum of a thrown, spinning soft body."""
    rows = _laws(results, FLIGHT, {ANGULAR_MOMENTUM, MOMENTUM})
    off = max(bar.values[MOMENTUM] for bar in rows)
    parts = [f"{percent(1 - bar.values[ANGULAR_MOMENTUM])} at {substeps_of(bar)} a frame" for bar in rows]
    return Claim(
        f"A soft body that is thrown spinning keeps its linear momentum to {number(off, 1)} of what gravity adds; it loses "
        f"{words.listed(parts)} of its angular momentum within {seconds(SECONDS[FLIGHT], 1)}, as position-based solvers do.",
        {"momentum": off, "kept": rows[-1].values[ANGULAR_MOMENTUM]}, off < EQUAL,
    )  # fmt: skip


@CLAIMS.add("body-rest", "Whether a dropped soft body comes to rest was not measured.")
def rest(results: Results) -> Claim:
    """Kinetic energy of a dropped soft body, and whether it comes to rest."""
    rows = _laws(results, DROP, {ENERGY})
    parts = [f"{number(bar.values[ENERGY], 1)} at {substeps_of(bar)} a frame" for bar in rows]
    still = [bar for bar in rows if bar.values[ENERGY] < STILL]
    text = (
        f"A soft body that was dropped has, after {seconds(SECONDS[DROP], 2)}, a kinetic energy of {words.listed(parts)} of "
        f"the drop's; less than {number(STILL, 1)} counts as rest"
    )
    if 0 < len(still) < len(rows):
        text += ": only friction and the step itself damp in that scene, and smaller steps damp less"
    numbers = {str(bar.substeps): bar.values[ENERGY] for bar in rows}
    return Claim(text + ".", numbers, bool(still))
