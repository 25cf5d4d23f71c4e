"""Pictures and clips that `softlab run` draws: their size, their view, and the view of a clip, fitted to the whole run."""

from __future__ import annotations

from pathlib import Path

from softlab.app.command.foaming import FRAME, frame_steps
from softlab.app.output.offscreen import MAX_SIZE, MIN_SIZE, Fitted, OffscreenRenderer
from softlab.app.output.video import CLIP, Picture, true_rate
from softlab.model.base.errors import SceneError
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import Scene

USUAL_RATE, MAX_RATE = 1 / FRAME, 240.0  # frames/s


def parse_size(text: str) -> tuple[int, int]:
    """Return (width, height) [pixels] of `WIDTHxHEIGHT`. Raises SceneError."""
    words = text.lower().split("x")
    known = len(words) == 2 and all(word.isascii() and word.isdigit() and len(word) < 7 for word in words)
    width, height = (int(word) for word in words) if known else (0, 0)
    if not (MIN_SIZE <= width <= MAX_SIZE and MIN_SIZE <= height <= MAX_SIZE):
        raise SceneError(
            "--size", text, f"must be WIDTHxHEIGHT, such as 1920x1080, each {MIN_SIZE} to {MAX_SIZE} pixels"
        )
    return width, height


def parse_camera(scene: Scene, text: str | None) -> Scene:
    """Return `scene` seen from `YAW,PITCH` or `YAW,PITCH,SIZE` (degrees, degrees, metres). Raises SceneError."""
    if text is None:
        return scene
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (2, 3):
        raise SceneError(
            "--camera", text, "must be YAW,PITCH or YAW,PITCH,SIZE, such as 30,15 (degrees) or 30,15,2 (2 m)"
        )
    if scene.dimensions == 2:
        raise SceneError("--camera", text, "applies to a scene in space; this one lies in a plane, so leave it out")
    fields = zip(("yaw", "pitch", "size"), values, strict=False)
    try:
        return scene.replace({f"camera.{name}": value for name, value in fields})
    except SceneError as error:
        raise SceneError("--camera", text, f"{error.field.partition('.')[2]} {error.allowed}") from None


def check_rate(fps: float, path: Path | None) -> None:
    """Raise SceneError for a rate that no clip can have, or of a picture."""
    if path is None or path.suffix.lower() != CLIP:
        raise SceneError("--fps", fps, f"applies to a clip; add --render FILE{CLIP}")
    if not 1 <= fps <= MAX_RATE:
        raise SceneError("--fps", fps, f"must be 1 to {MAX_RATE:g} frames per second")


class ClipView:
    """Fits the view of a clip to each frame during the run, so that the clip itself is drawn from one view; a context
    manager."""

    def __init__(self, simulation: Simulation, picture: Picture):
        self.every = frame_steps(simulation, 1 / picture.fps)
        self.rate = true_rate(self.every, simulation.scene.method.dt)
        self._renderer = OffscreenRenderer(
            simulation.scene,
            picture.width & ~1,
            picture.height & ~1,
            legend=picture.legend,
            view_options=picture.view_options,
        )
        self._renderer.show_bodies(simulation.body.inverse_mass)
        self.observe(simulation)

    def observe(self, simulation: Simulation) -> None:
        """Enlarge the view to contain the current state, which is a frame."""
        self._renderer.fit(simulation.read("position"), simulation.time)

    @property
    def fitted(self) -> Fitted:
        """Return the view that contains every frame so far."""
        return self._renderer.fitted

    def __enter__(self) -> ClipView:
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.close()
