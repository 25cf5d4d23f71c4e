"""Choice of the view and the camera of a scene: for a plane or space, a sheet, bodies or a world."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians

from softlab.app.presentation import presentation_of
from softlab.app.render.camera import Camera, Camera2D
from softlab.app.render.camera3d import Camera3D
from softlab.app.render.detail import FINE, usual_detail
from softlab.app.render.opengl import renderer_name
from softlab.app.render.view import View
from softlab.model.base.errors import InputError
from softlab.model.scene.scene import Scene


def view_of(scene: Scene, quick: bool = False) -> View:
    """Return a SheetView or, for bodies, a BodiesView or a TetrahedraView, for fluids a FluidView, for a world of these
    a WorldView, in the current OpenGL context. Raises BackendUnavailable.

    `quick`: frames matter more than edges and shadows, which are left out if a processor draws.
    """
    detail = usual_detail(renderer_name()) if quick else FINE
    return presentation_of(scene).view(scene, detail, quick, 0)


def camera_of(scene: Scene, width: int, height: int) -> Camera:
    """Return a Camera2D or, in space, a Camera3D for a window of `width` x `height` pixels. It has the direction of the
    scene's camera table and no target yet."""
    if scene.dimensions != 3:
        return Camera2D(width, height)
    camera, part = Camera3D(width, height), scene.camera
    if part is not None and part.yaw is not None:
        camera.yaw = radians(part.yaw)
    if part is not None and part.pitch is not None:
        camera.pitch = radians(part.pitch)
    return camera


def check_view_options(scene: Scene, view_options: Sequence[str]) -> None:
    """Raise InputError for a view option that scenes of this kind, or all scenes, lack."""
    known = presentation_of(scene).view_options()
    for name in view_options:
        if not known:
            raise InputError(f"--look {name}: applies to tetrahedral bodies and fluids; leave it out")
        if name not in known:
            raise InputError(f"--look {name}: must be one of {', '.join(known)}")
