"""The part `attachment`: connections of vertices of tetrahedral bodies, and of a cloth beside them, to the world, to
colliders and to one another."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from math import hypot

from pydantic import model_validator

from softlab.model.base.errors import SceneError
from softlab.model.base.table import NotNegative, Part, Vector
from softlab.model.base.words import suggestion
from softlab.model.tables.cloth import Collider
from softlab.model.tables.motion import Motion

LONGEST = 1e8  # s, or rad: how far ahead a collider's path is known to what is attached to it


class Attachment(Part):
    """Attaches vertices of a `body`, or of the cloth, to the world, a collider, another tetrahedral body, or the cloth.

    `vertices`: a side of the body's box, a region or `all`. `to` names a collider or a body; by default the world. With
    a `compliance` of 0, vertices attached to the world or a collider are pinned, and follow a moving collider.
    Otherwise each is pulled to its initial position, or to `point`, with the stiffness 1 / compliance. In another body
    a vertex keeps its place in the tetrahedron that contains it, or the nearest one: a constraint on all five vertices
    that conserves momentum; in the cloth it keeps its place in the nearest triangle.
    """

    body: str  # a tetrahedral body, or the cloth
    vertices: str  # of left, right (x), bottom, top (y), back, front (z), all, and names of regions
    to: str | None = None  # a collider, another tetrahedral body, or the cloth; by default the world
    compliance: NotNegative = 0.0  # m/N, of each vertex
    point: Vector | None = None  # m, of the world: a common position for all of these vertices

    @model_validator(mode="after")
    def _fits(self) -> Attachment:
        if self.to == self.body:
            raise ValueError("to: must be something else than the body itself")
        if self.point is not None and (self.to is not None or self.compliance == 0):
            raise ValueError("point: applies to an attachment to the world with a compliance over 0")
        return self

    def _idle_fields(self) -> set[str]:
        return super()._idle_fields() | {name for name in ("to", "point") if getattr(self, name) is None}


def pins(attachment: Attachment, bodies: Collection[str]) -> bool:
    """Return True if the attachment's vertices are pinned; `bodies`: the tetrahedral ones, and the cloth."""
    return attachment.compliance == 0 and attachment.to not in bodies


def motion_with(attachment: Attachment, collider: Collider) -> Motion | None:
    """Return the motion of vertices attached to a collider; None if the collider is at rest."""
    fields = collider.model_dump()
    spin = fields.get("spin", (0.0, 0.0, 0.0))
    speed = hypot(*spin)
    if not speed and not any(collider.velocity):
        return None
    return Motion(
        pins=attachment.vertices, body=attachment.body, velocity=collider.velocity, angular_velocity=speed,
        axis=tuple(spin) if speed else (1.0, 0.0, 0.0), center=fields.get("origin", (0.0, 0.0, 0.0)),
        duration=LONGEST / max(1.0, speed),
    )  # fmt: skip


def check_attachment(name: str, part: Attachment, bodies: Collection[str], colliders: Mapping[str, Collider]) -> None:
    """Raise SceneError if the body or the target of the attachment does not exist, or cannot be attached to."""
    if part.body not in bodies:
        reason = (
            f"must be a tetrahedral body or a cloth of the scene: {', '.join(bodies)}{suggestion(part.body, bodies)}"
        )
        raise SceneError(f"{name}.body", part.body, reason)
    others = [body for body in bodies if body != part.body]
    if part.to is not None and part.to not in (*others, *colliders):
        known = (*others, *colliders)
        reason = f"must be a collider or another tetrahedral body or cloth{suggestion(part.to, known)}; there "
        reason += f"are {', '.join(known)}" if known else "is none: leave it out for the world"
        raise SceneError(f"{name}.to", part.to, reason)
    collider = colliders.get(part.to or "")
    if collider and part.compliance > 0 and motion_with(part, collider):
        raise SceneError(f"{name}.compliance", part.compliance, f"must be 0, since {part.to} moves")
