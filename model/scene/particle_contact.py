"""The part of a scene that makes particles of bodies meet."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from model.scene.parts import NotNegative, Part, Positive, Sweeps

MAX_KINDS = 64  # bodies of a scene, copies not counted: their table is of all pairs


class Contact(Part):
    """Particles of bodies keep their distance, the sum of both radii, with Coulomb friction.

    Each substep searches who may meet whom; each sweep, after each iteration, pushes all apart at once. Which bodies meet:
    `group`, `avoids`, `self_collision`, and how they stick: `adhesion`, all of the bodies.

    What begins a substep nearer is moved apart at `separation_speed` at most: particles are, bodies follow as on a spring and
    part at up to twice that. What is left of an impact's overlap is taken for one that was there: below the speed of impacts,
    bodies get caught in each other. A particle never moves faster than `maximum_speed`, if given: what comes by more than an
    eighth of the distance in a substep may pass. Who comes faster than gravity adds in two substeps parts with `restitution`
    of that.
    """

    static_friction: NotNegative = 0.4
    dynamic_friction: NotNegative = 0.3
    separation_speed: Positive = 3.0  # m/s
    restitution: Annotated[float, Field(ge=0, le=1, strict=True)] = 0.0
    adhesion_reach: NotNegative = 0.25  # of the distance, beyond it: how far adhesion pulls
    sweeps: Sweeps = 1
    maximum_speed: Positive | None = None  # m/s
    sleeping_speed: NotNegative = 0.0  # m/s: what moved slower in a substep stays where it was

    @model_validator(mode="after")
    def _friction_is_ordered(self) -> Contact:
        if self.dynamic_friction > self.static_friction:
            raise ValueError(f"dynamic_friction: must be at most static_friction, {self.static_friction:g}")
        return self

    @model_serializer(mode="wrap")
    def _without_idle_fields(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """As scenes were written before there was restitution: what is measured of them is kept under that."""
        return {name: value for name, value in serialize(self).items() if name != "restitution" or value}
