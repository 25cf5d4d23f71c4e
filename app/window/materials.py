"""Changes of tetrahedral bodies' material by the window's keys, as fields of a scene."""

from __future__ import annotations

from collections.abc import Mapping

from softlab.app.presentation import presentation_of
from softlab.model.scene.scene import Scene
from softlab.model.tables.tetrahedra import LARGEST_RATIO, TetrahedralBody

FACTORS = {"young_modulus": 1.25, "poisson_ratio": 1.25, "damping": 2.0}  # of one press
FIRST_DAMPING, LAST_DAMPING = 1e-3, 1e-4  # s: the first one of a body that has none, and below which there is none
TEXTS = {"young_modulus": "E {:.3g} Pa", "poisson_ratio": "Poisson's ratio {:.3g}", "damping": "damping {:.3g} s"}


def bodies_of(scene: Scene) -> Mapping[str, TetrahedralBody]:
    """Return the bodies whose material the keys change, by name."""
    return presentation_of(scene).materials(scene)


def material_changes(scene: Scene, field: str, presses: int) -> dict[str, float]:
    """Return dotted path -> value of a `field` of every body after `presses` presses upward.

    For Poisson's ratio its distance from 1/2 changes by the factor: the stiffness against a change of volume is inverse
    to it.
    """
    factor = FACTORS[field] ** presses
    changes = {}
    for name, part in bodies_of(scene).items():
        value = getattr(part, field)
        if field == "poisson_ratio":
            value = min(max(0.5 - (0.5 - value) / factor, 0.0), LARGEST_RATIO)
        elif field == "damping":
            value = (value or (FIRST_DAMPING / factor if presses > 0 else 0.0)) * factor
            value = value if value >= LAST_DAMPING else 0.0
        else:
            value *= factor
        changes[f"{name}.{field}"] = value
    return changes


def material_at(scene: Scene, field: str, value: float) -> dict[str, float]:
    """Return dotted path -> value of a `field` of every body that sets the first one's to `value`: the others change
    by the same factor, and to or from 0 together with it. For Poisson's ratio the factor is that of its distance
    from 1/2."""
    bodies = list(bodies_of(scene).items())
    first = getattr(bodies[0][1], field)

    def follows(other: float) -> float:
        if other == first:
            return value
        if field == "poisson_ratio":
            return min(max(0.5 - (0.5 - other) * (0.5 - value) / (0.5 - first), 0.0), LARGEST_RATIO)
        return other * value / first if first else value

    return {f"{name}.{field}": follows(getattr(part, field)) for name, part in bodies}


def material_text(scene: Scene, field: str) -> str:
    """Return the current values of all bodies, each value once."""
    values = dict.fromkeys(TEXTS[field].format(getattr(part, field)) for part in bodies_of(scene).values())
    return ", ".join(values)
