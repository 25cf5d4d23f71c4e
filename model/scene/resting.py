"""Defaults of a scene with bodies: substeps in which bodies do not sink into colliders, and thicknesses of colliders at
which bodies rest on their skins; and notes on bodies that do not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, sqrt

import numpy as np

from softlab.model.assets.baked_body import BakedBody
from softlab.model.base.errors import naming
from softlab.model.geometry.arithmetic.functions import power
from softlab.model.geometry.arithmetic.ordered import mean
from softlab.model.scene.members import SUBSTEPS
from softlab.model.scene.scene_parts import SceneParts
from softlab.model.tables.bodies import BODY_KINDS, Placed
from softlab.model.tables.cloth import COLLIDER_KINDS, Collider
from softlab.model.tables.fluid import AMONG_BODIES, Fluid
from softlab.model.tables.method import Method
from softlab.model.tables.tetrahedra import TETRAHEDRAL_KINDS, TetrahedralBody

SINKING = 0.01  # of the spacing: how far a resting body may sink in a substep
MIN_THICKNESS = 0.01  # of the spacing, of a collider: rounding does not put a resting particle inside
MAX_SUBSTEPS = 100
TOLERANCE = 0.02  # of a body's longest side: a skin this near to a collider rests on it
TENTH = 1e-9  # of a substep: a number this little over an integer is rounded down
WITH_SUBSTEPS = {"xpbd": SUBSTEPS, "world": SUBSTEPS, "shape-matching": 1, "vbd": 1, "newton": 1}  # at least


@dataclass(frozen=True)
class _Size:
    """Lengths of each of the `copies` of a body [m]: the `spacing` of its particles or vertices, its longest side `extent`,
    and the `depth` of its outermost particles below its skin, the mean over the six sides of the box around it."""

    name: str
    copies: int
    spacing: float
    extent: float
    depth: float

    @property
    def thickness(self) -> float:
        """Thickness of colliders [m] at which the body rests on its skin."""
        return max(self.depth, MIN_THICKNESS * self.spacing)

    def height(self, thickness: float) -> float:
        """Return how far [m] the skin rests above colliders of this `thickness`; 0 within TOLERANCE."""
        above = thickness - self.thickness
        return above if abs(above) > TOLERANCE * self.extent else 0.0

    def longest_substep(self, gravity: float) -> float:
        """Return the longest substep h [s] in which the body sinks by at most SINKING spacings.

        In a substep all of its n layers fall by g h^2 and colliders lift only the lowest one. A rigid body, which moves
        by the mean, rests where its lowest layer is lifted by n g h^2: it has sunk by (n - 1) g h^2. Elastic bodies
        compress their lowest layer as much.
        """
        layers = max(self.extent / self.spacing, 1.0)
        return sqrt(SINKING * self.spacing / (layers * gravity))


def take_resting_defaults(scene: SceneParts) -> None:
    """Set the method's substeps, the colliders' thicknesses and the supports of fluids that the scene does not state.

    In a world each member chooses its own thicknesses. Raises SceneError, InputError (a body's mesh).
    """
    _take_supports(scene)
    unstated = {
        name: part for name, part in scene.parts_of(Collider).items() if "thickness" not in part.model_fields_set
    }
    if unstated and scene.all_of(*BODY_KINDS, *TETRAHEDRAL_KINDS):
        thickness = None if scene.is_world else _thickness(scene)
        for name, part in unstated.items():
            scene.derive(name, {"thickness": part.thickness if thickness is None else thickness})
    method = scene.one(Method)
    if method is None or "substeps" in method.model_fields_set or method.solver not in WITH_SUBSTEPS:
        return
    if not scene.all_of(*BODY_KINDS, *TETRAHEDRAL_KINDS) or scene.all_of("fluid"):
        return
    substeps = min(max(_needed(scene), WITH_SUBSTEPS[method.solver]), MAX_SUBSTEPS)
    scene.derive(scene.name_of("method"), {"substeps": substeps})


def _take_supports(scene: SceneParts) -> None:
    """Set the support of fluids among bodies, if none is stated, to one at which bodies rise and sink freely."""
    fluids = scene.parts_of(Fluid)
    if scene.all_of(*BODY_KINDS, *TETRAHEDRAL_KINDS) and all(part.support is None for part in fluids.values()):
        for name, part in fluids.items():
            scene.derive(name, {"support": AMONG_BODIES * part.rest_distance})


def resting_notes(scene: SceneParts) -> list[str]:
    """Return a run's notes on these defaults: more substeps than usual, or fewer than needed, and bodies whose skins do not
    rest on the colliders."""
    notes = [note for member in scene.members.values() for note in _height_notes(member)] + _height_notes(scene)
    name = scene.name_of("method")
    if "substeps" not in scene.derived.get(name, ()):
        return notes
    method, needed = scene.method, _needed(scene)
    if needed > MAX_SUBSTEPS:
        notes.append(
            f"{name}.substeps = {MAX_SUBSTEPS}, the most that is chosen: with fewer than {needed} bodies sink into colliders "
            f"by more than {100 * SINKING:g} % of their spacing; state {name}.substeps, a smaller {name}.dt or a larger "
            "spacing"
        )
    elif method.substeps > WITH_SUBSTEPS[method.solver]:
        notes.append(
            f"{name}.substeps = {method.substeps}, so that no body sinks into a collider by more than {100 * SINKING:g} % of "
            f"its spacing; state {name}.substeps to choose"
        )
    return notes


def _height_notes(scene: SceneParts) -> list[str]:
    """Return a note for each body whose skin rests above or below colliders of derived thickness; none for a world."""
    derived = [name for name in scene.all_of(*COLLIDER_KINDS) if "thickness" in scene.derived.get(name, ())]
    if scene.is_world or not derived:
        return []
    thickness: float = scene.value(f"{derived[0]}.thickness")
    colliders = ", ".join(derived)
    notes = []
    for size in _sizes(scene):
        height = size.height(thickness)
        if height:
            side, advice = ("above", "smaller") if height > 0 else ("below", "larger")
            percent = 100 * abs(height) / size.extent
            notes.append(
                f"{size.name}: its skin rests about {abs(height):.2g} m ({percent:.0f} % of its size) {side} {colliders}, "
                f"whose thickness of {thickness:.2g} m suits other bodies; give it particles as deep below its skin "
                f"(particle_spacing, surface_sampling), or {colliders} a {advice} thickness"
            )
    return notes


def _needed(scene: SceneParts) -> int:
    """Return the substeps per step for which no body sinks; 1 if nothing falls or there are no colliders."""
    gravity = scene.gravity.acceleration if scene.gravity else 0.0
    if not (gravity and scene.all_of(*COLLIDER_KINDS)):
        return 1
    longest = min(size.longest_substep(gravity) for size in _sizes(scene))
    return max(1, ceil(scene.method.dt / longest - TENTH))


def _thickness(scene: SceneParts) -> float:
    """Return the thickness [m] at which most bodies (counting copies) rest on their skins; the largest of several."""
    sizes = list(_sizes(scene))

    def suited(thickness: float) -> int:
        return sum(size.copies for size in sizes if not size.height(thickness))

    return max((size.thickness for size in sizes), key=lambda thickness: (suited(thickness), thickness))


def _sizes(scene: SceneParts) -> Iterator[_Size]:
    """Yield the sizes of all bodies. Raises SceneError, InputError, which name the body."""
    for name, part in scene.parts.items():
        with naming(name, files=True):
            if isinstance(part, Placed):
                yield _size_of_particles(name, part.count + part.spare, part.baked)
            elif isinstance(part, TetrahedralBody):
                mesh = part.cooked.mesh
                spacing = float(power(6 * mean(mesh.volumes), 1 / 3))
                yield _Size(name, 1, spacing, float(np.ptp(mesh.position, axis=0).max()), 0.0)


def _size_of_particles(name: str, copies: int, body: BakedBody) -> _Size:
    skin, particles = body.skin.position, body.position
    gaps = [particles.min(axis=0) - skin.min(axis=0), skin.max(axis=0) - particles.max(axis=0)]
    depth = float(np.clip(mean(np.concatenate(gaps)), 0.0, body.spacing))
    return _Size(name, copies, body.spacing, float(np.ptp(skin, axis=0).max()), depth)
