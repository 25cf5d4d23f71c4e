"""Draws a world into the current OpenGL context: each member by the view of its kind, with common colliders, light and
ground. A fluid, which is transparent, comes last."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.app.render.camera import Camera
from softlab.app.render.detail import FINE, Detail
from softlab.app.render.view import View
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import Scene

Parts = Callable[[Scene, Detail, int], View]  # its scene, the detail, the first of its colours


class WorldView(View):
    """A View of a world. `parts`: the members' views by name, each made by `make`; `lines`: of all that support them."""

    subject = "world"

    def __init__(self, scene: Scene, make: Parts, detail: Detail = FINE):
        super().__init__(scene, detail)
        self.vertices.shared = False  # each part has vertices of its own
        self.parts: dict[str, View] = {}
        colour = 0
        for name, member in scene.members.items():
            self.parts[name] = make(member, detail, colour)
            colour += len(member.body_set.copies) if member.bodies else len(member.tetrahedra)
        self._slices = scene.world_set.slices()

    def show_in(self, detail: Detail) -> None:
        super().show_in(detail)
        for part in self.parts.values():
            part.show_in(detail)

    def shine(self, light: np.ndarray) -> None:
        super().shine(light)
        for part in self.parts.values():
            part.shine(light)

    def show_colliders(self, shown: bool) -> None:
        super().show_colliders(shown)
        for part in self.parts.values():
            part.show_colliders(shown)

    def toggle_lines(self) -> bool:
        self.lines = not self.lines
        for part in self.parts.values():
            part.toggle_lines()
        return self.lines

    @property
    def wants_velocity(self) -> bool:
        return any(part.wants_velocity for part in self.parts.values())

    def toggle_foam(self) -> bool | None:
        """Show or hide the foam of every fluid."""
        shown = [part.toggle_foam() for part in self.parts.values()]
        return next((one for one in shown if one is not None), None)

    def name_legend(self) -> tuple[tuple[str, tuple[float, float, float]], ...]:
        """Return the legends of all members."""
        return tuple(named for part in self.parts.values() for named in part.name_legend())

    # ------------------------------------------------------------------ the state

    def know(self, velocity: np.ndarray | None, time: float) -> None:
        super().know(velocity, time)
        for name, part in getattr(self, "parts", {}).items():
            member_velocity = None if velocity is None else np.ascontiguousarray(velocity[self._slices[name]])
            part.know(member_velocity, time)

    def pin(self, scene: Scene) -> None:
        """Mark the pins of each member."""
        for name, part in self.parts.items():
            part.pin(scene.members[name])

    def upload(self, position: np.ndarray, normal: np.ndarray | None = None) -> None:
        """Send a state; each member computes its normals from its positions."""
        self.vertices.upload_state(position, False)
        for name, part in self.parts.items():
            part.upload(np.ascontiguousarray(position[self._slices[name]]))

    def upload_from(self, simulation: Simulation, position: np.ndarray | None = None) -> None:
        for name, part in self.parts.items():
            member_position = None if position is None else np.ascontiguousarray(position[self._slices[name]])
            part.upload_from(simulation.members[name], member_position)

    # ------------------------------------------------------------------ the frame

    def _draw_solid(self, camera: Camera, strain_range: float) -> None:
        for part in self.parts.values():
            part._draw_solid(camera, strain_range)

    def _draw_shadows(self, camera: Camera, time: float) -> None:
        for part in self.parts.values():
            part.lowest = self.lowest
            part._draw_shadows(camera, time)

    def _draw_over(self, camera: Camera, selected: int | None) -> None:
        for name, part in self.parts.items():
            place = self._slices[name]
            part.onto = self._target
            here = selected is not None and place.start <= selected < place.stop
            part._draw_over(camera, selected - place.start if here and selected is not None else None)

    def delete(self) -> None:
        """Free the buffers."""
        for part in self.parts.values():
            part.delete()
        super().delete()
