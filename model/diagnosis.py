"""Why a run diverged, and what to do about it, with numbers: what the message of `Diverged` says."""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan

import numpy as np

from model.integrators import INTEGRATORS, damping_rate, frequency_bound
from model.scene import Scene

FAST = 0.5  # spacings a step: a mass that moves farther passes its neighbours before their springs can turn it
MUCH = 2.0  # another integrator is named if its step size is so many times as large


@dataclass(frozen=True)
class Diagnosis:
    """`cause` and `remedy`, each a clause of one line."""

    cause: str
    remedy: str


def diagnose(scene: Scene, limit: float, velocity: np.ndarray | None = None) -> Diagnosis:
    """The diagnosis of a scene that diverged at its step size. `limit` [s]: the largest that holds in any state of the
    grid; `velocity` (particles, 2) [m/s] in the last good state, None where there is none."""
    method, dt = scene.method, scene.method.dt
    name = method.integrator
    other, reach = _other(scene)
    if limit == 0:
        return Diagnosis(
            f"{name} grows at every step size here",
            f"use {other} with dt <= {reach:.6g} s (--set method.integrator={other})",
        )
    if dt > limit:
        remedy = f"use dt <= {limit:.6g} s"
        if reach > MUCH * limit:
            remedy += f", or {other}, which holds to {reach:.6g} s (--set method.integrator={other})"
        return Diagnosis(f"dt is {dt / limit:.4g} times the stability limit of {name}", remedy)
    share = 0.0
    if velocity is not None and len(velocity):
        share = float(np.abs(velocity.astype(np.float64)).max()) * dt / scene.grid.spacing
    under = f"dt is under the linear limit of {limit:.6g} s"
    if share > FAST and not isnan(share):
        return Diagnosis(
            f"{under}, but a mass moved {share:.3g} spacings a step in the last good state",
            f"use dt <= {dt * FAST / share:.3g} s, or weaker forces",
        )
    return Diagnosis(f"{under}, so the forces on it are too violent", f"use dt <= {dt / 2:.6g} s, or weaker forces")


def _other(scene: Scene) -> tuple[str, float]:
    """(integrator, dt [s]) with one force evaluation and the largest step size that holds, the hand-out's aside, which
    solves another equation."""
    w, gamma = frequency_bound(scene), damping_rate(scene)
    able = [i for i in INTEGRATORS.values() if i.forces == 1 and i.order > 0]
    best = max(able, key=lambda i: (i.limit(w, gamma), i.order))
    return best.name, best.limit(w, gamma)
