"""Pictures without a window: OpenGL through EGL, with the same drawing as the window."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softlab.app.output.pictures import write_png
from softlab.app.render import colours
from softlab.app.render.camera import Camera, finite_bounds
from softlab.app.render.drawn_springs import drawn_strain
from softlab.app.render.fluid.framing import main_part, with_fluids
from softlab.app.render.framing import seen_points, seen_radius
from softlab.app.render.opengl import OFFSCREEN_REMEDY, drawing_text, open_window, renderer_name
from softlab.app.render.views import camera_of, check_view_options, view_of
from softlab.model.base.errors import InputError, SoftlabError
from softlab.model.base.files import check_target
from softlab.model.core.build import rest_positions
from softlab.model.core.simulation import Simulation
from softlab.model.core.spare import present
from softlab.model.fluid.foam import FoamPoints
from softlab.model.scene.scene import Scene

MARGINS = (40.0, 110.0, 40.0, 50.0)  # pixels at the left, bottom (legend), right, top (caption)
MIN_SIZE, MAX_SIZE = 16, 16384  # pixels


@dataclass(frozen=True)
class Fitted:
    """A view and a range of colours that contain every state they were fitted to."""

    camera: Camera
    strain_range: float


@dataclass(frozen=True)
class Picture:
    """`width` x `height` pixels, rounded down to even numbers for a clip, under a `caption` (None: the scene's title).

    A clip has `fps` frames/s, not necessarily an integer. `view_options`: see OffscreenRenderer.
    `legend` False: no text in the picture. `fitted`: the view of a clip (None: it widens with the motion).
    """

    width: int = 1280
    height: int = 960
    caption: str | None = None
    fps: float = 60
    view_options: tuple[str, ...] = ()
    legend: bool = True
    fitted: Fitted | None = None


class OffscreenRenderer:
    """Draws states of one scene into a picture of `width` x `height` pixels; a context manager.

    `draw(position)` draws and waits until it is drawn, `image()` returns the pixels. `legend=False` omits all text.
    `fit` sets the view and the range of colours; before its first call they are those of the rest state and of a
    strain of 0.5. A cloth is drawn as a lit surface, or with `lines` as springs coloured by strain, with the legend;
    bodies as their skins, or with `lines` as particles. `view_options`: how tetrahedra or fluids are drawn, of
    VIEW_OPTIONS in their view. Raises BackendUnavailable if off-screen OpenGL or a font is missing, InputError for
    an impossible size.
    """

    def __init__(
        self, scene: Scene, width: int = 1280, height: int = 960, *, legend: bool = True, lines: bool = False,
        view_options: Sequence[str] = (),
    ):  # fmt: skip
        from softlab.app.render.legends import Legends
        from softlab.app.render.panels import Panel, Style

        for name, value in (("width", width), ("height", height)):
            if not MIN_SIZE <= value <= MAX_SIZE:
                raise InputError(f"picture {name} = {value}: must be {MIN_SIZE} to {MAX_SIZE} pixels")
        self.scene, self._space = scene, scene.dimensions == 3
        self.width, self.height = width, height
        self.strain_range = 0.5
        self.caption = scene.title
        self._window = open_window(True, width, height)
        try:
            self.renderer = renderer_name()
            self._view = view_of(scene)
            if lines and not self._view.lines:
                self._view.toggle_lines()
            if view_options:
                check_view_options(scene, view_options)
                self._view.set_view_options(view_options)
            self._legends, self._panel = None, None
            if legend:
                with drawing_text():
                    self._panel = Panel("top-left", [Style(11, monospaced=False)])
                    self._legends = Legends(scene)
        except BaseException:
            self._window.close()
            raise
        self._fitted, self._fixed, self._closed = False, False, False
        self._weights: np.ndarray | None = None
        self._points: np.ndarray | None = None  # which the view is fitted to
        self.camera = camera_of(scene, width, height)
        self._frame(rest_positions(scene.grid), 0.0)

    def __enter__(self) -> OffscreenRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the picture and its buffers."""
        if not self._closed:
            self._window.switch_to()
            self._view.delete()
            self._window.close()
            self._closed = True

    def _frame(self, position: np.ndarray, time: float) -> None:
        """Fit the view to these positions; after the first `fit` it only widens, so that a clip does not jump."""
        fluid = with_fluids(self.scene)
        active = main_part(self.scene, position) if fluid else present(self.scene, position, self._weights)
        bounds = finite_bounds(active)
        if bounds is None:
            return
        margins = MARGINS if self._panel else (40.0, 40.0, 40.0, 40.0)
        legend = self._legends and self._legends.needed(self._view)
        if self._panel and (self._space or fluid) and not legend:
            margins = (40.0, 50.0, 40.0, 50.0)
        if self._space:
            self._view.lower_ground(bounds[1])
        points, radius = seen_points(self.scene, active, time), seen_radius(self.scene)
        if self._points is not None and self._fitted:
            points = np.concatenate([self._points, points])
        self.camera = self.camera.holding(points, margins, radius)
        self._points = self.camera.outermost(points, margins, radius)
        self.camera.aim(self.scene.camera)

    def show_bodies(self, inverse_mass: np.ndarray | None) -> None:
        """Hide the bodies that these inverse masses (particles,), as in State, mark as inactive; None: those of the
        start of the scene."""
        if self.scene.copies:
            self._weights = inverse_mass
            self._view.show_bodies(inverse_mass)

    def fit(self, position: np.ndarray, time: float = 0.0) -> None:
        """Enlarge the view and the range of colours to contain a state (particles, dimensions) [m] at `time` [s]; not
        after `fix`."""
        if self._fixed:
            return
        self._frame(position, time)
        if (self._legends and self._legends.needed(self._view)) or self.scene.springs:
            fitted = colours.strain_range(drawn_strain(self.scene, position))
            self.strain_range = max(fitted, self.strain_range) if self._fitted else fitted
        self._fitted = True

    @property
    def fitted(self) -> Fitted:
        """Return the view and the range of colours of `fit` so far."""
        return Fitted(self.camera, self.strain_range)

    def fix(self, fitted: Fitted) -> None:
        """Draw with this view and range of colours from now on."""
        self.camera, self.strain_range, self._fixed = fitted.camera, fitted.strain_range, True

    @property
    def wants_velocity(self) -> bool:
        """True if the drawing depends on velocities: speeds, foam."""
        return bool(self._view.wants_velocity)

    def show_foam(self, points: FoamPoints | None) -> None:
        """Show the spray and foam particles `points` of a fluid."""
        if points is not None:
            self._view.show_foam(points)

    def draw(
        self, position: np.ndarray, time: float = 0.0, normal: np.ndarray | None = None,
        velocity: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        """Draw a state (particles, dimensions) [m] and return when it is drawn. Raises InputError for other shapes.

        `time` [s] gives the positions of moving colliders; in space `normal` (particles, 3) are the cloth's, if known;
        `velocity` (particles, dimensions) [m/s], if known, is used if `wants_velocity`.
        """
        self._window.switch_to()
        self._view.know(velocity, time)
        self._view.upload(position, normal)
        self._draw(time)

    def show(self, simulation: Simulation) -> None:
        """Draw a simulation's current state and return when it is drawn; the data stay on the GPU if the same one
        draws."""
        self._window.switch_to()
        self._view.upload_from(simulation)
        self._draw(simulation.time)

    @property
    def transfer(self) -> str:
        """Return in words how the last state was transferred to the graphics card."""
        return self._view.vertices.transfer

    def _draw(self, time: float) -> None:
        from pyglet import gl

        gl.glViewport(0, 0, self.width, self.height)
        gl.glClearColor(*colours.BACKGROUND, 1.0)
        gl.glClear(gl.GL_COLOR_BUFFER_BIT)
        self._view.draw(self.camera, self.strain_range, time=time)
        if self._legends is not None:
            self._legends.draw(self._view, self.width, self.strain_range)
        if self._panel is not None and self.caption:
            self._panel.place(self.caption, self.width, self.height)
            self._panel.draw()
        gl.glFinish()

    def image(self) -> np.ndarray:
        """Return (height, width, 4) uint8, top row first: the last drawing."""
        self._window.switch_to()
        return read_pixels(self.width, self.height)


def read_pixels(width: int, height: int) -> np.ndarray:
    """Return (height, width, 4) uint8, top row first, opaque: the frame buffer of the current context."""
    from pyglet import gl

    pixels = np.empty((height, width, 4), dtype=np.uint8)
    pointer = pixels.ctypes.data_as(ctypes.c_void_p)
    gl.glPixelStorei(gl.GL_PACK_ALIGNMENT, 1)
    gl.glReadPixels(0, 0, width, height, gl.GL_RGBA, gl.GL_UNSIGNED_BYTE, pointer)
    pixels[:, :, 3] = 255
    return pixels[::-1]


def render_frame(
    scene: Scene,
    position: np.ndarray,
    path: Path | str,
    picture: Picture = Picture(),
    *,
    lines: bool = False,
    time: float = 0.0,
    inverse_mass: np.ndarray | None = None,
    velocity: np.ndarray | None = None,
    foam: FoamPoints | None = None,
) -> Path:
    """Draw a state (particles, dimensions) [m] of `scene` into a PNG and return its path.

    In space, `lines`: as springs, or particles, instead of a surface; `time` [s]: for the positions of moving colliders;
    `inverse_mass`, as in State: marks inactive bodies; `velocity` (particles, dimensions) [m/s] and `foam`: of a fluid,
    if known. Raises InputError (name, folder, size, shape) and BackendUnavailable (no off-screen OpenGL).
    """
    path = check_target(path, (".png",))
    with OffscreenRenderer(
        scene, picture.width, picture.height, legend=picture.legend, lines=lines, view_options=picture.view_options
    ) as renderer:
        renderer.show_bodies(inverse_mass)
        renderer.fit(position, time)
        if picture.caption is not None:
            renderer.caption = picture.caption
        renderer.show_foam(foam)
        renderer.draw(position, time, velocity=velocity)
        return write_png(path, renderer.image())


def opengl_available(text: bool = True) -> tuple[bool, str]:
    """Return (True if pictures can be drawn off-screen here, the renderer's name or what is missing and how to install
    it).

    `text` False: pictures without a legend, which need no fonts. Tried in a separate process, because a process that
    has used pyglet with EGL cannot open a window any more.
    """
    code = f"from softlab.app.output.offscreen import probe; probe({text})"
    try:
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return False, f"the OpenGL test did not finish ({type(error).__name__}); {OFFSCREEN_REMEDY}"
    lines = [line for line in done.stdout.splitlines() if line.startswith(("works ", "fails "))]
    if not lines:  # a driver that crashed the process
        return False, f"the OpenGL test ended with status {done.returncode}; {OFFSCREEN_REMEDY}"
    word, _, detail = lines[-1].partition(" ")
    return word == "works", detail


def probe(text: bool) -> None:
    """Print `works RENDERER` or `fails REASON; REMEDY`; the trial of `opengl_available`."""
    try:
        with OffscreenRenderer(
            Scene({"grid": {"rows": 2, "columns": 2}, "springs": {}}), 64, 64, legend=text
        ) as renderer:
            renderer.draw(rest_positions(renderer.scene.grid))
            if len(np.unique(renderer.image().reshape(-1, 4), axis=0)) < 2:
                print(f"fails {renderer.renderer} draws blank pictures; {OFFSCREEN_REMEDY}")
                return
            print("works", renderer.renderer)
    except SoftlabError as error:
        print("fails", " ".join(str(error).split()))
    except Exception as error:  # errors of a driver are a result too
        print(f"fails {type(error).__name__}: {' '.join(str(error).split())}; {OFFSCREEN_REMEDY}")
