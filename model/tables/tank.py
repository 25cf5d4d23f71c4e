"""The part `tank`: one table of a scene file that is expanded into the planes of its floor and walls."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from softlab.model.base.errors import SceneError
from softlab.model.base.table import NotNegative, Number, Positive
from softlab.model.tables.cloth import Collider, Plane

TANK = "tank"  # the kind of table
Sizes = Annotated[tuple[Positive, ...], Field(min_length=2, max_length=3)]
Place = Annotated[tuple[Number, ...], Field(min_length=2, max_length=3)]


class Tank(Collider):
    """A floor and walls about the box from `origin` to `origin` + `size`: in space five planes, in a plane (two numbers
    each) three; one more unless `open_top`. A scene reads it as these planes, named after the table, as tank-floor,
    tank-left, tank-right, tank-back, tank-front and tank-top, and writes them back."""

    thickness: NotNegative = 0.0  # m; default for bodies without a fluid: as for planes, the depth at which they rest
    size: Sizes  # m, width and height, in space also depth
    origin: Place = (0.0, 0.0, 0.0)  # m, its lower left corner, in space at the back
    open_top: bool = True

    @model_validator(mode="after")
    def _origin_fits_the_size(self) -> Tank:
        if len(self.origin) < len(self.size):
            raise ValueError(f"origin: must hold {len(self.size)} numbers, as many as size")
        return self

    def check(self, name: str, dimensions: int) -> None:
        """Raise SceneError for a tank whose number of axes differs from its scene's."""
        if len(self.size) != dimensions:
            wanted = "width, height" if dimensions == 2 else "width, height, depth"
            raise SceneError(f"{name}.size", list(self.size), f"must hold {dimensions} numbers in this scene: {wanted}")

    def planes(self, name: str, derives_thickness: bool = False) -> dict[str, Plane]:
        """Return the planes of the tank that a scene calls `name`, by their names. Every normal points into the tank.

        `derives_thickness`: leave a thickness that is not stated to what the scene derives (model/scene/resting.py).
        """
        shared = {field: getattr(self, field) for field in Collider.model_fields}
        if derives_thickness and "thickness" not in self.model_fields_set:
            del shared["thickness"]
        x, y, z = (*self.origin, 0.0)[:3]
        width, height, *depth = self.size
        planes = {
            "floor": ((x, y, z), (0.0, 1.0, 0.0)),
            "left": ((x, y, z), (1.0, 0.0, 0.0)),
            "right": ((x + width, y, z), (-1.0, 0.0, 0.0)),
        }
        if depth:
            planes |= {"back": ((x, y, z), (0.0, 0.0, 1.0)), "front": ((x, y, z + depth[0]), (0.0, 0.0, -1.0))}
        if not self.open_top:
            planes["top"] = (x, y + height, z), (0.0, -1.0, 0.0)
        return {
            f"{name}-{side}": Plane(point=point, normal=normal, **shared) for side, (point, normal) in planes.items()
        }
