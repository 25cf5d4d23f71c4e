"""The mouse over the demo's window: dragging masses and moving the view.

Coordinates are frame-buffer pixels from the lower left corner.
"""

from __future__ import annotations

import numpy as np

from softlab.app.presentation import presentation_of
from softlab.app.render.camera import Camera, pick
from softlab.app.render.camera3d import Camera3D
from softlab.app.window.window_protocol import WindowProtocol

PLANE_PICK_RADIUS = 22.0  # pixels from the pointer within which a mass of a plane is taken
SPACE_PICK_RADIUS = 10.0  # in space, where beside the masses is what turns the view
BODY_PICK_RADIUS = 0.9  # particle spacings, if that is more: what is seen of a body is taken, between its particles too
ZOOM = 1.15  # per notch of the wheel


class Mouse:
    """The left button drags a mass, or a body by one of its particles, in the plane parallel to the window through it.
    Right and middle move the view; in space the middle button, and the left one on the background, rotate it.
    `pointer`: place of the left button on a mass, or None."""

    def __init__(self, viewer: WindowProtocol):
        self.viewer, self.demo = viewer, viewer.demo
        self.button = viewer.pyglet.window.mouse
        self.pointer: tuple[float, float] | None = None
        self._moving: int | None = None  # the button that moves the view
        self._taken: np.ndarray = np.zeros(0)  # m, where the mass lay

    @property
    def _camera(self) -> Camera:
        return self.viewer.camera

    def _take(self, x: float, y: float) -> bool:
        """Take the mass at a place in the window, if there is one."""
        position = self.demo.position
        particle = pick(self._camera, position, x, y, self._pick_radius(position))
        if particle is None:
            return False
        self._taken = position[particle].astype(np.float64)
        return self.demo.take(particle, self._camera.on_plane(x, y, self._taken))

    def _pick_radius(self, position: np.ndarray) -> float | np.ndarray:
        """Return the pick radius [pixels]; for bodies one per particle (particles,)."""
        scene = self.demo.world.scene
        if not presentation_of(scene).grips:
            return SPACE_PICK_RADIUS if self.viewer.space else PLANE_PICK_RADIUS
        _, depth = self._camera.project(position)
        radius = np.fmax(SPACE_PICK_RADIUS, BODY_PICK_RADIUS * scene.grid.spacing * self._camera.focal / depth)
        return np.where(self.demo.world.body.inverse_mass == 0, -1.0, radius)  # what waits is not there to be taken

    def pull(self) -> None:
        """Update the pointer's position in the world, once per frame, since the view may have moved."""
        if self.pointer is not None:
            self.demo.drag(*self._camera.on_plane(*self.pointer, self._taken))

    def press(self, x: float, y: float, button: int) -> None:
        """Handle a button that went down."""
        if button == self.button.LEFT and self.demo.compiling is None and self._take(x, y):
            self.pointer = x, y
        elif button in (self.button.RIGHT, self.button.MIDDLE) or (self.viewer.space and button == self.button.LEFT):
            self._moving = button

    def drag(self, x: float, y: float, dx: float, dy: float) -> None:
        """Handle the pointer at (x, y), moved by (dx, dy), with a button down."""
        if self.pointer is not None:
            self.pointer = x, y
        elif self._moving is not None and (self._moving == self.button.RIGHT or not self.viewer.space):
            self.viewer.follow = False
            self._camera.pan(dx, dy)
        elif self._moving is not None:
            camera = self._camera
            assert isinstance(camera, Camera3D)
            camera.orbit(dx, dy)  # what is followed is followed from any side

    def release(self, button: int) -> None:
        """Handle a button that went up."""
        if button == self.button.LEFT and self.pointer is not None:
            self.pointer = None
            self.demo.release()
        else:
            self._moving = None

    def scroll(self, x: float, y: float, notches: float) -> None:
        """Handle a turn of the wheel."""
        self.viewer.follow = False
        self._camera.zoom(ZOOM**notches, x, y)
