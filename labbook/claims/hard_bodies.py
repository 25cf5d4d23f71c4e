"""Claims of the lab book on the hard cases of bodies, and its table of them; rules in labbook/claims/claim.py."""

from __future__ import annotations

from collections.abc import Sequence

from softlab.bench.experiments.body_laws import SECONDS, SPIN
from softlab.bench.measure import words
from softlab.bench.measure.words import count, number, percent, seconds
from softlab.bench.stress.bodies import OFF_LAW, OFF_NEWTON, OUT_OF_SHAPE, SPIN_FRACTION
from softlab.bench.stress.results import HardRow
from softlab.labbook.claims.claim import Claim, Claims
from softlab.labbook.claims.hard import compare_backends, count_verdicts, measured_value
from softlab.plots.core.data import Results, needed
from softlab.plots.figures.hard_bodies import body_rows

CLAIMS = Claims()
FEW = 0.02  # fraction of the spin that rounding may take without a remark


def _rows(results: Results) -> list[HardRow]:
    return body_rows(results)[0]


@CLAIMS.add("hard-bodies", "The hard cases of bodies were not run.")
def verdicts(results: Results) -> Claim:
    """Number of runs by verdict."""
    return count_verdicts(needed(_rows(results)))


CLAIMS["hard-body-backends"] = lambda results: compare_backends(*body_rows(results))


def _one(rows: list[HardRow], case: str, precision: str = "float64") -> HardRow | None:
    """Return the run of a case in a precision, on the first backend that has it."""
    return next((row for row in rows if (row.case, row.precision) == (case, precision)), None)


def _values(row: HardRow | None, names: Sequence[str]) -> list[float]:
    """Return the numbers of a run by name, or an empty list if one is missing."""
    values = [measured_value(row, name) for name in names] if row else [None]
    return [value for value in values if value is not None] if None not in values else []


@CLAIMS.add("hard-body-spin", "The spin of a rigid body was not judged.")
def spin(results: Results) -> Claim:
    """S7 and A8: remaining spin of a rigid body, and where float32 deviates from the law."""
    rows = _rows(results)
    cases = sorted({row.case for row in rows if row.case.startswith("S7 ")}, key=_substeps)
    by_case = {
        case: values for case in cases if (values := _values(_one(rows, case), (SPIN_FRACTION, OFF_LAW, OFF_NEWTON)))
    }
    parts = [f"{percent(remaining)} with {_substeps(case)}" for case, (remaining, _, _) in needed(by_case).items()]
    off = max(values[1] for values in by_case.values())
    last = list(by_case)[-1]
    text = (
        f"A rigid body that turns once a second keeps of its spin, after {seconds(SECONDS[SPIN], 1)}, {words.listed(parts)} "
        f"substeps a frame. This agrees with the law of the method, by which these rows are judged, to {number(off, 1)}. "
        f"Newton's law conserves all of it: with {_substeps(last)} substeps the body is {number(by_case[last][2], 2)} "
        "spacings "
        "from where that law puts it."
    )
    numbers = {"off": off, "kept": by_case[last][0]}
    single = {
        case: values for case in by_case if (values := _values(_one(rows, case, "float32"), (SPIN_FRACTION, OFF_LAW)))
    }
    worst = max(single, key=lambda case: single[case][1], default="")
    if worst and single[worst][1] > FEW:
        numbers["float32"] = single[worst][0]
        text += (
            f" In float32 {percent(single[worst][0])} is left with {_substeps(worst)} substeps, because rounding is a part "
            "of so small a turn."
        )
    return Claim(text, numbers, off < FEW)


def _substeps(case: str) -> int:
    return int(case.split()[1])


@CLAIMS.add("hard-body-shapes", "Bodies were not squashed.")
def shapes(results: Results) -> Claim:
    """A10: recovery of squashed and mirrored bodies."""
    squashed = [row for row in _rows(results) if row.case.startswith("A10")]
    rows = [row for row in squashed if measured_value(row, OUT_OF_SHAPE) is not None]
    worst = max(measured_value(row, OUT_OF_SHAPE) or 0.0 for row in needed(rows))
    starts = len({row.case for row in rows})
    return Claim(
        "A jelly that was squashed flat, onto a line or into a point, mirrored or turned inside out recovers its "
        f"shape, in {count(len(rows))} runs of {count(starts)} such starts to {percent(worst)} of a spacing.",
        {"worst": worst, "runs": float(len(rows))}, all(row.verdict == "pass" for row in rows),
    )  # fmt: skip
