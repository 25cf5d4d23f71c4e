"""The camera, and the light."""

from __future__ import annotations

from math import asin, atan2, degrees, radians

from softlab.app.render.camera3d import MAX_PITCH, Camera3D
from softlab.app.window.panel.sections.frame import PanelFrame

LOWEST, HIGHEST = 10.0, 88.0  # degrees, of the light: flatter, shadows go on and on; straight above it has no turn
CLOSER = 50.0  # a slider's reach of distances and scales, as a factor to either side


def _light(frame: PanelFrame) -> None:
    """Lay out the direction of the light that throws shadows."""
    rows, view_options = frame.rows, frame.viewer.view_options
    x, y, z = frame.viewer.views[0].light.tolist()
    azimuth, height = atan2(x, z), asin(min(max(y, -1.0), 1.0))
    chosen = rows.slider("Light rotation", degrees(azimuth), -180, 180, "°")
    if chosen is not None:
        view_options.shine(radians(chosen), height)
    chosen = rows.slider("Light elevation", degrees(height), LOWEST, HIGHEST, "°")
    if chosen is not None:
        view_options.shine(azimuth, radians(min(max(chosen, LOWEST), HIGHEST)))


def view(frame: PanelFrame) -> None:
    """Lay out the camera's direction and distance, the light, and whether the camera follows."""
    viewer, rows = frame.viewer, frame.rows
    camera = viewer.camera
    if isinstance(camera, Camera3D):
        yaw = (degrees(camera.yaw) + 180) % 360 - 180
        chosen = rows.slider("Rotation", yaw, -180, 180, "°")
        if chosen is not None:
            camera.yaw = radians(chosen)
        most = degrees(MAX_PITCH)
        chosen = rows.slider("Elevation", degrees(camera.pitch), -most, most, "°")
        if chosen is not None:
            camera.pitch = radians(min(max(chosen, -most), most))
        size = max(world.body.size for world in frame.demo.worlds)
        chosen = rows.slider("Distance", camera.distance, size / CLOSER, size * CLOSER, "m", True)
        if chosen is not None and chosen > 0:
            viewer.follow = False
            camera.magnify(camera.distance / chosen)
    else:
        usual = viewer.height / max(max(world.body.size for world in frame.demo.worlds), 1e-9)
        chosen = rows.slider("Zoom", camera.scale, usual / CLOSER, usual * CLOSER, "px/m", True)
        if chosen is not None and chosen > 0:
            viewer.follow = False
            camera.magnify(chosen / camera.scale)
    if viewer.space:
        _light(frame)
    if rows.check("Follow the motion", viewer.follow):
        viewer.follow = not viewer.follow
    if rows.button("Fit everything in view", -1.0):
        viewer.frame_everything()
