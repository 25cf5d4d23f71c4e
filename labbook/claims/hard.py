"""Claims of the lab book on the hard cases, and its tables of them; rules in labbook/claims/claim.py."""

from __future__ import annotations

from collections.abc import Sequence

from softlab.bench.measure import words
from softlab.bench.measure.words import count, number
from softlab.bench.stress.numbers import SLOW_DOWN
from softlab.bench.stress.results import CODES, VERDICT, HardRow, disagreements, in_full, rounding_differences
from softlab.labbook.claims.claim import Claim, Claims, committed_of
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.older import older_items
from softlab.plots.figures.hard import hard_rows

CLAIMS = Claims()
NOT_RUN = "The hard cases were not run."
HOME = 1e-6  # m: a smaller distance from the hanging grid counts as having returned to it


def verdict_rows(results: Results) -> list[HardRow]:
    """Return the verdicts of the chapter."""
    return hard_rows(results)[0]


def measured_value(row: HardRow, name: str) -> float | None:
    """Return a measured number of a run by its name, or None."""
    return next((check.value for check in row.checks if check.name == name), None)


def older_verdicts(rows: Sequence[HardRow], sources: Sequence[Source]) -> str:
    """Return a sentence on the verdicts of these `sources` whose kernels are not proved to be today's, or nothing."""
    older = {
        item.configuration for source in sources for item in older_items(source) if getattr(item, "name", "") == VERDICT
    }
    number_older = sum(row.configuration in older for row in rows)
    return (
        f" {count(number_older)} of {count(len(rows))} verdicts are of older sources."
        if 0 < number_older < len(rows)
        else ""
    )


def count_verdicts(rows: Sequence[HardRow], sources: Sequence[Source] = ()) -> Claim:
    """Number of these runs by verdict; `sources`: of the rows."""
    if not rows:
        return Claim(NOT_RUN)
    counts = {verdict: sum(row.verdict == verdict for row in rows) for verdict in CODES}
    cases = len({row.case for row in rows})
    one, more = ("was", "its"), ("were", "their")
    outcomes = [f"{count(counts['pass'])} passed"]
    if counts["refused"]:
        outcomes.append(
            f"{count(counts['refused'])} {(one if counts['refused'] == 1 else more)[0]} refused with a diagnosis"
        )
    if counts["known"]:
        outcomes.append(
            f"{count(counts['known'])} failed as {(one if counts['known'] == 1 else more)[1]} method implies"
        )
    text = f"Of {count(len(rows))} runs of {count(cases)} cases, {words.listed(outcomes)}; "
    if counts["fail"]:
        bad = [f"“{title}”" for title in dict.fromkeys(row.in_full for row in rows if row.verdict == "fail")]
        text += f"{count(counts['fail'])} failed otherwise, which is a bug of this lab: {words.listed(bad)}."
    else:
        text += f"none failed{' otherwise' if counts['known'] else ''}."
    text += older_verdicts(rows, sources)
    return Claim(text, {**{k: float(v) for k, v in counts.items()}, "runs": float(len(rows))}, not counts["fail"])


def compare_backends(rows: Sequence[HardRow], sources: Sequence[Source] = ()) -> Claim:
    """Comparison of the verdicts of both backends in these runs, which are from `sources`."""
    if not rows:
        return Claim("The verdicts of the two backends were not compared.")
    names = sorted({row.backend for row in rows})
    if len(names) < 2:
        return Claim(f"They were run on the {names[0].upper()} alone, so the backends are not compared here.")
    different, rounded = disagreements(rows, in_full), rounding_differences(rows, in_full)
    combinations: dict[tuple[str, str, str], set[str]] = {}
    for row in rows:
        combinations.setdefault((row.case, row.integrator, row.precision), set()).add(row.backend)
    pairs = sum(len(backends) == len(names) for backends in combinations.values())
    alone = len(combinations) - pairs
    if not pairs:
        return Claim("No combination of case, method and precision was run on both backends.")
    both = " and ".join(f"{name.upper()}{committed_of(sources, name)}" for name in names)
    if not different:
        text = (
            f"The verdicts of {both} are the same in {f'{count(pairs - len(rounded))} of' if rounded else 'all'} "
            f"{count(pairs)} combinations of case, method and precision that ran on both."
        )
        if rounded:
            text += (
                f" In {count(len(rounded))} a failure that the method implies shows on one of them alone, because fast "
                f"math rounds differently there ({'; '.join(each.rpartition(': ')[0] for each in rounded)})."
            )
    else:
        text = f"Of {count(pairs)} combinations that ran on both, {both} differ in {count(len(different))}, "
        text += f"a bug of this lab: {'; '.join(different)}."
    if alone:
        text += f" {count(alone)} more ran on one backend alone."
    return Claim(
        text, {"different": float(len(different)), "pairs": float(pairs), "alone": float(alone)}, not different
    )


CLAIMS["hard-verdicts"] = lambda results: count_verdicts(*hard_rows(results))
CLAIMS["hard-backends"] = lambda results: compare_backends(*hard_rows(results))


@CLAIMS.add("hard-known", "No run failed by the nature of its method.")
def known(results: Results) -> Claim:
    """Failures that are inherent in a method, with the reasons."""
    reasons: dict[str, dict[str, set[str]]] = {}
    for row in verdict_rows(results):
        if row.verdict == "known":
            reasons.setdefault(row.diagnosis, {}).setdefault(row.integrator, set()).add(row.case)
    parts = []
    for reason, where in needed(reasons).items():
        counted = [f"{name} in {words.things(len(cases), 'case')}" for name, cases in where.items()]
        parts.append(f"{words.listed(counted)}: {reason}")
    return Claim(
        f"Failures that the method itself implies: {'; '.join(parts)}.", {"reasons": float(len(reasons))}, True
    )


@CLAIMS.add("hard-far", "Chains far from the origin were not run in float32.")
def far(results: Results) -> Claim:
    """B14: distance of a chain far from the origin, in float32, from its run at the origin."""
    rows = [r for r in verdict_rows(results) if r.case.startswith("B14") and r.precision == "float32"]
    name = "distance from the run at the origin"
    parts, numbers = [], {}
    for integrator in ("velocity-verlet", "lab"):
        values = [v for r in rows if r.integrator == integrator and (v := measured_value(r, name)) is not None]
        if values:
            numbers[integrator] = max(values)
            parts.append(f"{number(max(values), 2)} units in the last place with {integrator}")
    off = words.listed(needed(parts))
    text = f"A chain released far from the origin ends, in float32, at most {off} from its run at the origin"
    if "lab" in numbers and numbers["lab"] > numbers.get("velocity-verlet", 0.0):
        text += ": the hand-out takes its velocity from two rounded positions, the others store it"
    return Claim(text + ".", numbers, True)


@CLAIMS.add("hard-collapsed", "A grid collapsed to a point was not run.")
def collapsed(results: Results) -> Claim:
    """B5: end states of a grid that was collapsed to a point."""
    rows = [r for r in verdict_rows(results) if r.case == "B5 point" and r.precision == "float64"]
    away = needed([v for r in rows if (v := measured_value(r, "distance from the hanging grid")) is not None])
    home = sum(value < HOME for value in away)
    returned = count(home) if home else "none"
    text = f"Of {count(len(away))} runs from a single point in float64, {returned} came back to the hanging grid"
    if home < len(away):
        text += f", the others to rest in another equilibrium, up to {number(max(away), 2)} m from it"
    return Claim(text + ".", {"runs": float(len(away)), "home": float(home), "farthest": max(away)}, True)


@CLAIMS.add("hard-denormals", "The cost of denormal numbers was not measured.")
def denormal(results: Results) -> Claim:
    """B15: cost of denormal numbers."""
    rows = [r for r in verdict_rows(results) if r.case == "B15"]
    ratios: dict[str, float] = {}
    for row in rows:
        value = measured_value(row, "time over that of ordinary numbers")
        if value is not None:
            ratios[row.backend] = max(value, ratios.get(row.backend, 0.0))
    parts = [f"{number(value, 2)} on the {backend.upper()}" for backend, value in needed(ratios).items()]
    over = [f"on the {backend.upper()}" for backend, value in ratios.items() if value > SLOW_DOWN]
    verdict = f"; {words.listed(over)} that is more than" if over else ", within"
    text = f"Denormal numbers slow a step down by a factor of at most {words.listed(parts)}{verdict} the {SLOW_DOWN:g} "
    text += "aimed at."
    return Claim(text, ratios, True)
