"""Motion of the demo's camera with the scene, and the position at which a body is dropped."""

from __future__ import annotations

import numpy as np

from softlab.app.render.camera import Margins, joined_bounds
from softlab.app.render.camera3d import Camera3D
from softlab.app.render.collider_shapes import with_colliders
from softlab.app.render.fluid.framing import main_part, with_fluids, with_tank
from softlab.app.window.panes import IN_A_ROW
from softlab.app.window.window_protocol import WindowProtocol

MARGINS = (50.0, 130.0, 50.0, 130.0)  # pixels left, bottom (legend), right, top (numbers)
TITLE = 80.0  # of a pane, instead of the numbers
FOLLOW_SIZE = 4.0  # times the scene: a state that blows up is to be seen blowing up, not shrinking out of sight


class Following:
    """Moves the camera with a viewer's worlds, starting from their positions at construction."""

    def __init__(self, viewer: WindowProtocol):
        self.viewer, self.demo = viewer, viewer.demo
        starts = [main_part(world.scene, world.body.position) for world in self.demo.worlds]
        axes = self.demo.world.scene.dimensions
        ends = [(p.min(axis=0), p.max(axis=0)) for p in starts if len(p)] or [(np.zeros(axes), np.zeros(axes))]
        self._widens = any(with_fluids(world.scene) for world in self.demo.worlds)
        self._widest: tuple[float, ...] | None = None
        self._start = np.min([low for low, _ in ends], axis=0), np.max([high for _, high in ends], axis=0)

    def drop_place(self, x: float, y: float) -> tuple[float, float, float]:
        """Return the position where D drops a body: above everything, under a point of the pane (frame-buffer pixels),
        at the depth of the camera's target."""
        everything, camera = self._everything(), self.viewer.camera
        across, above, toward = camera.on_plane(x, y, camera.target)
        return across, max(above, everything[4]) if everything else above, toward

    def _everything(self) -> tuple[float, ...] | None:
        """Return the box [m] of the view, as `finite_bounds` returns it."""
        bounds, worlds = self.demo.statistics.bounds, self.demo.worlds
        low, high = self._start
        space = self.viewer.space
        middle = (low + high) / 2 if space else np.array([low[0], high[1]])
        half_size = FOLLOW_SIZE * max(world.body.size for world in worlds)
        half = len(middle)
        least, most = np.maximum(bounds[:half], middle - half_size), np.minimum(bounds[half:], middle + half_size)
        if not (least <= most).all():
            return None
        if space:
            for view in self.viewer.views:
                view.lower_ground(float(least[1]))
        seen = (*least.tolist(), *most.tolist())
        return joined_bounds(
            [with_tank(world.scene, with_colliders(world.scene, seen, world.time), world.time) for world in worlds]
        )

    def approach(self, fraction: float) -> None:
        """Move the camera by `fraction` of the way to the view that shows everything.

        With fluids the view only widens unless `fraction` is 1: flying drops would change the size of the tank.
        """
        bounds = self._everything()
        if bounds is None:
            return
        if self._widens:
            bounds = bounds if self._widest is None or fraction == 1.0 else joined_bounds([self._widest, bounds])
            self._widest = bounds
        spacing = max(world.scene.grid.spacing for world in self.demo.worlds)
        camera = self.viewer.camera
        wanted = camera.framing(bounds, self._margins(), spacing)
        wanted.aim(self.demo.world.scene.camera)
        camera.approach(wanted, fraction)

    def stay_above_ground(self) -> None:
        """Keep the camera above the ground, in space."""
        camera = self.viewer.camera
        if isinstance(camera, Camera3D):
            for view, world in zip(self.viewer.views, self.demo.worlds, strict=True):
                for ground in view.grounds(world.time):
                    camera.stay_above(ground.point, ground.normal)

    def _margins(self) -> Margins:
        """Return the margins of a pane."""
        panes = self.viewer.panes
        if len(panes) == 1:
            return MARGINS
        left, bottom, right, _ = MARGINS
        return (left, bottom, right, TITLE) if len(panes) <= IN_A_ROW else (left / 2, bottom / 2, right / 2, TITLE)
