"""Energies and strain of any scene, in float64 on the host; for judging and showing, not for stepping."""

from __future__ import annotations

import numpy as np

from model.core.build import masses
from model.core.families import family_of
from model.scene.scene import Scene
from model.shape_matching.spare import absent


def spring_strain(
    scene: Scene, position: np.ndarray, kind: str = "structural", plastic: np.ndarray | None = None
) -> np.ndarray:
    """(springs,) float64: (length - rest) / rest, in the order of the family's springs (see `sheet_strain`, `edge_strain`);
    `kind` of a cloth's springs. Of bodies: (entries,), see `goal_strain`."""
    return family_of(scene).strain(scene, position, kind, plastic)


STORING = ("grid", "cloth", "springs", "structural", "shear", "bending", "gravity", "perturbation", "method")


def keeps(scene: Scene) -> str:
    """What the step of a sheet does to its `conserved` energy, as a clause: whether it keeps it, or what else would have to
    be left out of the scene."""
    rates = {"damping": "coefficient", "external": "magnitude"}
    acting = [
        kind
        for name, kind in scene.kinds.items()
        if kind not in STORING and getattr(scene.parts[name], rates.get(kind, "kind"), 1) != 0
    ]
    along = any(getattr(part, "damping", 0) for part in scene.parts.values())
    if along or "damping" in acting:
        return "would conserve without damping"
    return "would conserve if nothing acted on it" if acting else "conserves"


def energies(
    scene: Scene,
    position: np.ndarray,
    velocity: np.ndarray,
    plastic: np.ndarray | None = None,
    inverse_mass: np.ndarray | None = None,
    wetness: np.ndarray | None = None,
) -> dict[str, float]:
    """Energies in joules: `kinetic`, `spring`, `gravity`, `potential` (both), `total`, `conserved`; of a cloth also that of
    its springs by kind. Where clusters take the place of springs, `spring` is theirs; `plastic`, `inverse_mass` and
    `wetness` as in State: what waits by the second (None: at the scene's start) has none.

    With the true mass. Gravity's zero is at y = 0. `conserved` is what the scheme itself keeps (up to a bounded
    wobble) without damping: the total, except for the hand-out's step `lab`, which moves exactly like semi-implicit
    Euler with doubled masses under the same forces, and so keeps 2 * kinetic + potential.
    """
    gravity, v = scene.gravity, np.asarray(velocity, dtype=np.float64)
    mass = masses(scene, absent(scene, inverse_mass))  # what waits is at rest, and stores nothing
    if wetness is not None:
        mass = mass * (1 + scene.one("wetting").capacity * wetness[:, None])
    kinetic = 0.5 * float(np.sum(mass * v * v))
    spring, by_kind = family_of(scene).stored(scene, position, plastic)
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
