"""Energies and strain of any scene, in float64 on the host, for accuracy checks and display, not for stepping."""

from __future__ import annotations

import numpy as np

from softlab.model.core.build import masses
from softlab.model.core.families import family_of
from softlab.model.core.family import NO_ARRAYS, Arrays
from softlab.model.core.spare import inactive
from softlab.model.scene.scene import Scene


def spring_strain(
    scene: Scene, position: np.ndarray, kind: str = "structural", arrays: Arrays = NO_ARRAYS
) -> np.ndarray:
    """Return (length - rest) / rest, (springs,) float64, in the order of the family's springs (see `sheet_strain`,
    `edge_strain`).

    `kind`: kind of a cloth's springs. Bodies: (entries,), see `goal_strain`.
    """
    return family_of(scene).strain(scene, position, kind, arrays)


STORING = ("grid", "cloth", "springs", "structural", "shear", "bending", "gravity", "perturbation", "method")


def keeps(scene: Scene) -> str:
    """Return a clause on the step's effect on a sheet's `conserved` energy: conserved, or which parts would have to be
    removed."""
    rates = {"damping": "coefficient", "external": "magnitude"}
    acting = [
        kind
        for name, kind in scene.kinds.items()
        if kind not in STORING and scene.value(f"{name}.{rates.get(kind, 'kind')}", 1) != 0
    ]
    along = any(getattr(part, "damping", 0) for part in scene.parts.values())
    if along or "damping" in acting:
        return "would conserve without damping"
    return "would conserve if nothing acted on it" if acting else "conserves"


def energies(
    scene: Scene,
    position: np.ndarray,
    velocity: np.ndarray,
    arrays: Arrays = NO_ARRAYS,
    inverse_mass: np.ndarray | None = None,
) -> dict[str, float]:
    """Return energies [J]: `kinetic`, `spring`, `gravity`, `potential` (the sum of the last two), `total`, `conserved`.

    A cloth also has those of its springs by kind. Where clusters replace springs, `spring` is theirs. `arrays` and
    `inverse_mass` as in State. Particles that are inactive by `inverse_mass` (None: at the scene's start)
    have no energy. Energies use the true mass. Gravity's zero is at y = 0. `conserved` is the quantity that the scheme
    conserves (up to a bounded oscillation) without damping. It is the total, except for the hand-out's step `lab`,
    which moves exactly like semi-implicit Euler with doubled masses under the same forces, and so conserves 2 * kinetic
    + potential.
    """
    gravity, v = scene.gravity, np.asarray(velocity, dtype=np.float64)
    mass = masses(scene, inactive(scene, inverse_mass))  # inactive particles are at rest and store no energy
    kinetic = 0.5 * float(np.sum(mass * v * v))
    spring, by_kind = family_of(scene).stored(scene, position, arrays)
    height = 0.0
    if gravity and gravity.enabled:
        y = np.asarray(position, dtype=np.float64)[:, 1:2]
        height = gravity.acceleration * float(np.sum(mass * y))
    potential = spring + height
    lab = scene.method.solver == "mass-spring" and scene.method.integrator == "lab"
    inertia = 2.0 if lab else 1.0
    return {
        "kinetic": kinetic,
        "spring": spring,
        "gravity": height,
        "potential": potential,
        "total": kinetic + potential,
        "conserved": inertia * kinetic + potential,
        **by_kind,
    }
