"""Where a picture of a scene is taken from: a table of a scene file that changes nothing of what is simulated."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from model.core.errors import SceneError
from model.scene.parts import Number, Part, Positive, Vector

CAMERA = "camera"  # the table's name


class CameraPart(Part):
    """`yaw` [degrees] turns the camera about the vertical, `pitch` [degrees] lifts it above the horizontal; both in space
    only. `target` [m] lies in the middle of the picture, whose height at that depth is `size` [m]. A field that is left
    out follows from what the run shows."""

    yaw: Number | None = None
    pitch: Annotated[float, Field(ge=-89, le=89, allow_inf_nan=False, strict=True)] | None = None
    target: Vector | None = None
    size: Positive | None = None

    def check(self, dimensions: int) -> None:
        """Raise SceneError for a camera that is turned in a scene of two `dimensions`."""
        for name, value in (("yaw", self.yaw), ("pitch", self.pitch)):
            if dimensions == 2 and value is not None:
                raise SceneError(f"{CAMERA}.{name}", value, "applies to a scene in space; this one is plane")

    def _idle_fields(self) -> set[str]:
        return {name for name in type(self).model_fields if getattr(self, name) is None}
