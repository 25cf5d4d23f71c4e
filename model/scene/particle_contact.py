"""The part `contact`: collisions between bodies."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from model.scene.parts import NotNegative, Part, Positive, Sweeps, friction_is_ordered

MAX_KINDS = 64  # bodies of a scene, copies not counted: their table has all pairs


class Contact(Part):
    """Particles of bodies keep their distance, the sum of both radii, with Coulomb friction.

    Each substep searches who may meet whom; each sweep, after each iteration, pushes all apart at once. Which bodies meet:
    `group`, `avoids`, `self_collision`, and how they stick: `adhesion`, all of the bodies.

    What begins a substep nearer is moved apart at `separation_speed` at most: particles are, bodies follow as on a spring and
    part at up to twice that. What is left of an impact's overlap is taken for one that was there: below the speed of impacts,
    bodies get caught in each other. A particle never moves faster than `maximum_speed`, if given: what comes by more than an
    eighth of the distance in a substep may pass. Who comes faster than gravity adds in two substeps parts with `restitution`
    of that.

    Of tetrahedral bodies the surfaces keep a `distance`, a vertex of one from the triangles of another; what was nearer, or
    lies inside, is moved out at `separation_speed` at most. What comes by more than the distance in a substep may get caught
    inside. They know friction and `sweeps` beside it: 4, or what sticks creeps. A cloth beside them meets them
    likewise, with both its sides; what has come through it stays on the other one.
    """

    distance: Positive | None = None  # m, of tetrahedral bodies and a cloth: a quarter of the shortest edge unless told
    static_friction: NotNegative = 0.4
    dynamic_friction: NotNegative = 0.3  # at most static_friction
    separation_speed: Positive = 3.0  # m/s
    restitution: Annotated[float, Field(ge=0, le=1, strict=True)] = 0.0
    adhesion_reach: NotNegative = 0.25  # of the distance, beyond it: how far adhesion pulls
    sweeps: Sweeps = 1
    maximum_speed: Positive | None = None  # m/s
    sleeping_speed: NotNegative = 0.0  # m/s: what moved slower in a substep stays where it was

    _friction_is_ordered = model_validator(mode="after")(friction_is_ordered)

    def _idle_fields(self) -> set[str]:
        idle = set() if self.restitution else {"restitution"}
        return idle if self.distance is not None else idle | {"distance"}
