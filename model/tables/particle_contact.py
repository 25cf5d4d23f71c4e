"""The part `contact`: collisions between bodies."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from softlab.model.base.table import NotNegative, Part, Positive, Sweeps
from softlab.model.tables.parts import friction_is_ordered

MAX_KINDS = 64  # bodies of a scene, copies not counted: their table has all pairs


class Contact(Part):
    """Collisions of bodies: their particles keep a distance, the sum of both radii, with Coulomb friction.

    Each substep searches for pairs; each sweep, after each iteration, pushes all apart at once. `group`, `avoids` and
    `self_collision` of the bodies select which of them collide, `adhesion` how they stick. Particles that begin a
    substep nearer are moved apart at `separation_speed` at most; their bodies follow as on a spring and separate at up
    to twice that. The remaining overlap of an impact is treated the same: if `separation_speed` is below the speed of
    impacts, bodies get caught in each other. A particle never exceeds `maximum_speed`, if given: particles that
    approach by more than an eighth of the distance in a substep may pass. Particles that approach faster than gravity
    adds in two substeps separate with the fraction `restitution` of that speed.

    The surfaces of tetrahedral bodies keep a `distance`, a vertex of one from the triangles of another; vertices that
    are nearer, or lie inside, are moved out at `separation_speed` at most. Vertices that approach by more than the
    distance in a substep may get caught inside. Surfaces also use friction and `sweeps`: with fewer than 4, sticking
    bodies creep. A cloth beside them collides with them too, on both sides; a part that has passed through it stays on
    the other side.
    """

    distance: Positive | None = None  # m, of tetrahedral bodies and a cloth: by default a quarter of the shortest edge
    static_friction: NotNegative = 0.4
    dynamic_friction: NotNegative = 0.3  # at most static_friction
    separation_speed: Positive = 3.0  # m/s
    restitution: Annotated[float, Field(ge=0, le=1, strict=True)] = 0.0
    adhesion_reach: NotNegative = 0.25  # of the distance, beyond it: how far adhesion pulls
    sweeps: Sweeps = 1
    maximum_speed: Positive | None = None  # m/s
    sleeping_speed: NotNegative = 0.0  # m/s: particles slower than that in a substep stay in place

    _friction_is_ordered = model_validator(mode="after")(friction_is_ordered)

    def _idle_fields(self) -> set[str]:
        idle = set() if self.restitution else {"restitution"}
        return idle if self.distance is not None else idle | {"distance"}
