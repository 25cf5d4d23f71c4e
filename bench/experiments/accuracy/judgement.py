"""Measures of the end state of one run: its error or the reason why there is none, and statistics.

Where the motion is chaotic at that time (bench/experiments/growth.py) the distance to the reference is refused: the error
is infinite, with a reason that begins with `REFUSED`. What can still be compared with the reference are statistics: the
energy, the centre of mass, the largest strain and the momentum.
"""

from __future__ import annotations

import math

import numpy as np

from softlab.bench.experiments.accuracy.judge import distance
from softlab.bench.experiments.growth import DISTURBANCE, Growth
from softlab.bench.reference.cache import Converged
from softlab.model.base.errors import Diverged
from softlab.model.core.build import masses
from softlab.model.core.energy import energies, spring_strain
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

ERROR, LARGEST = "accuracy_error", "accuracy_error_largest"
HALF = "accuracy_error_half"
ENERGY, ENERGY_OFF = "accuracy_energy", "accuracy_energy_off"
STRAIN, STRAIN_OFF = "accuracy_strain", "accuracy_strain_off"
MEAN_OFF, MOMENTUM_OFF = "accuracy_mean_off", "accuracy_momentum_off"
GROWTH = "accuracy_growth"
SOLVER = "accuracy_solver_error"  # defined in bench/experiments/accuracy/solver_error.py, like the two residuals
CONSTRAINT, BALANCE = "accuracy_residual_constraint", "accuracy_residual_balance"
UNRESOLVED, ESTIMATE = "unresolved", "reference_estimate"

RESOLVED = 10  # an error below this multiple of the reference's own error is not resolved
REFUSED = "refused: "  # prefix of the reason of a refused error

Numbers = dict[str, tuple[float, str, str | None]]  # name -> value, unit, reason


def refusal(growth: Growth) -> str:
    """Return the reason why the error of a trajectory is refused at the end of `growth`."""
    return (
        f"{REFUSED}chaotic by {growth.times[-1]:g} s: a disturbance of {DISTURBANCE:g} spacings grows "
        f"{growth.factor:.1e} times; compare statistics, or judge earlier"
    )


def judge(
    scene: Scene, outcome: State | Diverged, newton: Converged, growth: Growth, half: Converged | None = None
) -> Numbers:
    """Return the measures of one run; `outcome` is its end state, or its divergence.

    `newton`: the reference at the same time; `half`: the reference of x'' = a / 2, with which only `lab` is compared
    too. Errors and `MEAN_OFF` are in spacings, energies in J, momenta in kg m/s.
    """
    spacing = scene.grid.spacing
    estimate = newton.estimate / spacing
    numbers: Numbers = {
        GROWTH: (growth.factor, "", f"of {DISTURBANCE:g} spacings"),
        ESTIMATE: (estimate, "spacing", None),
        UNRESOLVED: (0.0, "", None),
    }
    if isinstance(outcome, Diverged):
        numbers[ERROR] = numbers[LARGEST] = (math.inf, "spacing", str(outcome))
        return numbers
    free = outcome.inverse_mass > 0
    numbers |= _statistics(scene, outcome, newton, free)
    if growth.chaotic:
        numbers[ERROR] = numbers[LARGEST] = (math.inf, "spacing", refusal(growth))
        return numbers
    error, largest = distance(outcome.position, newton.position, free, spacing) if free.any() else (0.0, 0.0)
    unresolved = error < RESOLVED * estimate
    note = f"RMS over the free masses; the reference's own error is {estimate:.1e} spacings"
    numbers[ERROR] = (error, "spacing", note + ("; not resolved by it" if unresolved else ""))
    numbers[LARGEST] = (largest, "spacing", None)
    numbers[UNRESOLVED] = (float(unresolved), "", None)
    if half is not None and scene.method.name == "lab":
        numbers[HALF] = (distance(outcome.position, half.position, free, spacing)[0], "spacing", "x'' = a / 2")
    return numbers


def _statistics(scene: Scene, state: State, right: Converged, free: np.ndarray) -> Numbers:
    """Return the measures that can be compared even if the motion is chaotic."""
    energy = energies(scene, state.position, state.velocity)["total"]
    its_energy = energies(scene, right.position, right.velocity)["total"]
    strain, its_strain = (
        float(np.abs(spring_strain(scene, position)).max(initial=0.0)) for position in (state.position, right.position)
    )
    off = {
        name: np.asarray(ours, np.float64)[free] - theirs[free]
        for name, ours, theirs in (
            ("position", state.position, right.position),
            ("velocity", state.velocity, right.velocity),
        )
    }
    mean = np.linalg.norm(off["position"].mean(axis=0)) / scene.grid.spacing if free.any() else 0.0
    mass = np.broadcast_to(masses(scene), (len(free), 1))[free]
    momentum = np.linalg.norm((mass * off["velocity"]).sum(axis=0))
    return {
        ENERGY: (energy, "J", None),
        ENERGY_OFF: (energy - its_energy, "J", None),
        STRAIN: (strain, "", None),
        STRAIN_OFF: (strain - its_strain, "", None),
        MEAN_OFF: (float(mean), "spacing", "of the centre of mass"),
        MOMENTUM_OFF: (float(momentum), "kg m/s", None),
    }
