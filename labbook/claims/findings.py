"""Claims of the lab book on single findings (bench/experiments/findings/experiment.py).

Rules in labbook/claims/claim.py.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from softlab.bench.experiments.findings.experiment import AWAY, DAMPERS, DAMPING, DISSIPATION, FLOOR, oscillator
from softlab.bench.measure import words
from softlab.bench.measure.words import number, percent, seconds
from softlab.labbook.claims.accuracy import NEAR, SCENE, quoted_points
from softlab.labbook.claims.claim import Claim, Claims, named
from softlab.model.core.integrators import INTEGRATORS, amplification_matrix
from softlab.plots.core.accuracy_points import observed_order
from softlab.plots.core.apart import apart
from softlab.plots.core.backends import on_backends
from softlab.plots.core.data import Results, needed
from softlab.plots.findings.points import Row, exact_pairs, of_finding

CLAIMS = Claims()
NOTHING = 1e-10  # 1/s: rounding of the measurement; smaller rates of dissipation are called none
# The compute-shader cloth (its own constants): stiffness [N/m], mass [kg], damping [N s/m], the step size that it uses
# [s], and the largest eigenvalue of the Laplacian of a grid with diagonals, which bounds w^2 m / k in any state.
CLOTH = {"stiffness": 8000.0, "mass": 0.1, "damping": 0.25, "dt": 5e-6, "eigenvalue": 12.0}


@CLAIMS.add("verlet-damping", "What an explicit damper costs velocity Verlet was not measured.")
def verlet_damping(results: Results) -> Claim:
    """Order of velocity Verlet with an explicit damper (first) and with an implicit one (second)."""
    _, measured = of_finding(results, DAMPING)
    by_scheme = {scheme: [row for row in measured if row.scheme == scheme] for scheme in DAMPERS}
    implicit, explicit = (needed(observed_order([(r.dt, r.value) for r in by_scheme[scheme]])) for scheme in DAMPERS)
    fine, plain = (min(by_scheme[scheme], key=lambda row: row.dt) for scheme in DAMPERS)
    numbers = {"implicit": implicit, "explicit": explicit, "ratio": plain.value / fine.value}
    text = (
        f"With the damper implicit in the second half kick the observed order is {implicit:.2f}, with an explicit one "
        f"{explicit:.2f}"
    )
    if abs(implicit - 2) > NEAR or abs(explicit - 1) > NEAR:
        return Claim(f"{text}; second and first order were expected.", numbers, False)
    text += (
        f": an order is lost, and at {seconds(fine.dt, 2)} the error is {words.times(numbers['ratio'])} as large for the "
        "same forces."
    )
    return Claim(text, numbers, True)


@CLAIMS.add("cloth-limit")
def cloth_limit(results: Results) -> Claim:
    """Stability limit of the compute-shader cloth's step and of semi-implicit Euler with the same springs."""
    w = math.sqrt(CLOTH["eigenvalue"] * CLOTH["stiffness"] / CLOTH["mass"])
    gamma = CLOTH["damping"] / CLOTH["mass"]
    taylor, better = (INTEGRATORS[name].limit(w, gamma) for name in ("taylor", "semi-implicit-euler"))
    text = (
        f"With the compute-shader cloth's own constants the limit of its step (taylor) is {seconds(taylor, 4)}, of which it "
        f"uses {percent(CLOTH['dt'] / taylor)}; semi-implicit Euler holds to {seconds(better)} with the same springs, "
        f"{number(better / taylor)} times as far, for the same forces."
    )
    return Claim(text, {"taylor": taylor, "better": better, "ratio": better / taylor}, True)


def _least(rows: Sequence[Row], scheme: str, precision: str) -> Row | None:
    finite = [row for row in rows if (row.scheme, row.precision) == (scheme, precision) and math.isfinite(row.value)]
    return min(finite, key=lambda row: row.value, default=None)


@CLAIMS.add("float32-least", "The smallest error in float32 was not measured.")
def floor(results: Results) -> Claim:
    """Smallest error in float32, and the increase of the error at smaller steps."""
    _, measured = of_finding(results, FLOOR)
    parts, numbers, worse = [], {}, True
    for scheme in dict.fromkeys(row.scheme for row in measured):
        least = _least(measured, scheme, "float32")
        runs = [row for row in measured if (row.scheme, row.precision) == (scheme, "float32")]
        if least is None:
            continue
        smallest = min(runs, key=lambda row: row.dt)
        numbers[scheme] = least.value
        worse = worse and smallest.value > 2 * least.value
        parts.append(f"{number(least.value, 2)} spacings with {scheme}, at {seconds(least.dt, 2)}")
    text = f"In float32 the smallest error on {SCENE} is {words.listed(needed(parts))}"
    if not worse:
        return Claim(f"{text}; no rise at smaller steps was seen.", numbers, False)
    return Claim(f"{text}; still smaller steps make it worse, because each of them rounds once more.", numbers, True)


@CLAIMS.add("far-away", "Far from the origin, float32 was not measured.")
def far_away(results: Results) -> Claim:
    """B14: the hand-out's step and velocity Verlet far from the origin in float32."""
    _, measured = of_finding(results, AWAY)
    farthest = max((row.offset for row in measured), default=0.0)
    at = {row.scheme: row.value for row in measured if row.offset == farthest}
    needed(farthest > 0 and {"lab", "velocity-verlet"} <= set(at))
    lab, verlet = at["lab"], at["velocity-verlet"]
    where = f"At {number(farthest, 1)} m from the origin a falling chain in float32 is off by"
    text = f"{where} {number(lab, 2)} spacings after a second with lab and by {number(verlet, 2)} with velocity-verlet"
    if lab < 2 * verlet:
        return Claim(f"{text}: no clear difference.", at, False)
    return Claim(f"{text}: lab rounds its velocity, a difference of two positions, in every step.", at, True)


def theory(scheme: str, dt: float) -> float:
    """Return the rate [1/s] at which the amplitude falls (negative: grows): -ln |eigenvalue of one step| / dt.

    For the oscillator of bench/experiments/findings/experiment.py, from the step's matrix (model/core/integrators.py).
    """
    matrix = amplification_matrix(scheme, dt, _frequency(), 0.0)
    return -math.log(float(np.abs(np.linalg.eigvals(matrix)).max())) / dt


@cache
def _frequency() -> float:
    """Angular frequency [1/s] of the oscillator, which has the same mass and spring under every scheme."""
    scene = oscillator("lab", 0.01)
    assert scene.springs is not None
    return float((scene.springs.stiffness / scene.grid.mass) ** 0.5)


@CLAIMS.add("dissipation", "The numerical damping of the steps was not measured.")
def dissipation(results: Results) -> Claim:
    """Change of an undamped oscillation by each integrator, compared with theory."""
    measured = needed(of_finding(results, DISSIPATION)[1])
    off = max(
        (abs(row.value - theory(row.scheme, row.dt)) for row in measured if abs(row.value) <= NOTHING), default=0.0
    )
    shown = [row for row in measured if abs(row.value) > NOTHING]
    relative = max((abs(row.value / theory(row.scheme, row.dt) - 1) for row in shown), default=0.0)
    dt = max((row.dt for row in measured if row.dt <= 0.01), default=measured[0].dt)
    schemes = list(dict.fromkeys(row.scheme for row in measured))
    none = [name for name in schemes if all(abs(row.value) <= NOTHING for row in measured if row.scheme == name)]
    parts = []
    for row in (row for row in shown if row.dt == dt):
        gain = math.expm1(-row.value)
        change = (
            f"grows to {words.times(1 + gain)} its size" if gain > 1 else f"{_changes(gain)} by {percent(abs(gain))}"
        )
        parts.append(f"{change} under {row.scheme}")
    numbers = {"relative": relative, "off": off}
    start = (
        f"Within a second of steps of {seconds(dt, 2)} an undamped oscillation {words.listed(parts)}" if parts else ""
    )
    neutral = f"{words.listed(none)} keep it to rounding" if none else ""
    text = "; ".join(filter(None, (start, neutral)))
    agree = relative < 1e-2
    verdict = "as the eigenvalues of a step predict" if agree else "which is not what the eigenvalues of a step predict"
    return Claim(f"{text}, {verdict} (to {number(relative, 1)} of it).", numbers, agree)


def _changes(gain: float) -> str:
    return "grows" if gain > 0 else "shrinks"


@CLAIMS.add("exact-cost", "The cost of exact math was not measured.")
def exact_cost(results: Results) -> Claim:
    """Time of a step in exact math over that in fast math, by backend, in float32 at the largest size."""
    parts, numbers, supported = [], {}, False
    for backend, source, pairs in on_backends(results, exact_pairs):
        fast, exact = pairs[-1]
        ratio = exact.median / fast.median
        numbers[backend] = ratio
        where = f"the {named(source, backend)}"
        if apart(exact, fast) > 0:
            supported = True
            parts.append(f"{words.times(ratio)} as long on {where} ({words.masses(fast.particles)})")
        else:
            parts.append(f"no longer beyond measurement noise on {where} ({words.masses(fast.particles)})")
    return Claim(f"A step of velocity Verlet in exact math takes {words.listed(needed(parts))}.", numbers, supported)


@CLAIMS.add("growth", "The growth of a disturbance was not measured.")
def growth(results: Results) -> Claim:
    """Growth of a disturbance up to the end time, which decides whether errors of trajectories have a meaning."""
    factor, *_ = needed([p.growth for p in quoted_points(results) if p.growth is not None])
    text = f"By the end of {SCENE} a disturbance of a billionth of a spacing has changed by a factor of {number(factor, 2)}"
    if factor <= 1:
        return Claim(f"{text}: the motion forgets it, and errors keep their meaning.", {"growth": factor}, True)
    return Claim(f"{text}; errors are to be read with that in mind.", {"growth": factor}, False)
