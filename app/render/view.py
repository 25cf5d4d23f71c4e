"""Common part of every drawing of a scene: points and a ring; in space also smooth edges, light, colliders, and a
ground with shadows. The window and the off-screen pictures both draw through it.

A plane is drawn with the same shaders, without perspective (app/render/camera.py) and without depth: what is drawn
later lies on top, directly in the window, and lines have fading edges.

Plain OpenGL buffers are used for the masses instead of pyglet's vertex lists, whose element-wise interface takes tens
of milliseconds for a large grid; here the upload is one copy of the float32 positions, or none if the GPU that computes
also draws (app/render/cuda_vertices.py).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from ctypes import c_uint
from dataclasses import replace
from typing import Protocol

import numpy as np

from softlab.app.render import colours, shaders
from softlab.app.render.camera import Camera
from softlab.app.render.collider_shapes import Ground, grounds
from softlab.app.render.cuda_vertices import CudaVertices
from softlab.app.render.detail import FINE, Detail
from softlab.app.render.opengl import shader_program
from softlab.app.render.scenery import Lit, Scenery
from softlab.app.render.smooth_target import SmoothTarget
from softlab.app.render.vertex_arrays import uniform_matrix
from softlab.model.core.build import rest_positions
from softlab.model.core.simulation import Simulation
from softlab.model.core.spare import present
from softlab.model.fluid.foam import FoamPoints
from softlab.model.scene.scene import Scene

RING = 22.0  # pixels


class Shining(Protocol):
    """Something lit: `shine` sets the direction (3,) to the light, a unit vector."""

    def shine(self, light: np.ndarray) -> None: ...


class View(ABC):
    """Draws `scene` on the graphics card. Needs a current OpenGL 3.3 context, the same in every call.

    `upload(position)` sends a state, `upload_from(simulation)` a simulation's; `draw(camera, ...)` draws it; `delete()`
    frees the buffers. `detail`: quality in space. `lines`: springs, edges or particles are drawn instead of surfaces (a
    change needs a new upload). Raises BackendUnavailable.
    """

    lines = False
    colliders = True  # whether they are drawn, in space
    subject = "sheet"  # what it shows, by which the window's keys go: bodies, tetrahedra, fluid
    colourings: tuple[str, ...] = ()  # what `next_colouring` goes through
    options: tuple[str, ...] = ("lines",)  # what can be shown or hidden, each an attribute that `toggle_NAME` changes
    # Of views with other `options` or `colourings`, of bodies, and of families with `view_options`:
    skin: bool
    particles: bool
    foam: bool
    colouring: str
    toggle_skin: Callable[[], bool | None]
    next_colouring: Callable[[], None]
    show_bodies: Callable[[np.ndarray | None], None]
    set_view_options: Callable[[Sequence[str]], None]

    def __init__(self, scene: Scene, detail: Detail = FINE):
        self.scene, self.space = scene, scene.dimensions == 3
        self.detail = detail if self.space else FINE
        self.vertices = CudaVertices(scene)
        self.know(None, 0.0)
        self._point_program = shader_program(shaders.VERTEX, shaders.POINT_FRAGMENT)
        if self.space:
            self.lowest = float(
                present(scene, rest_positions(scene.grid))[:, 1].min()
            )  # of all that was shown: the ground lies below it
            self._target = SmoothTarget(detail)
            self._scenery = Scenery(scene)
            self._lit = Lit()

    onto: SmoothTarget | None = None  # of a view that this is a part of: what that draws into

    def shows(self, option: str) -> bool:
        """Return the value of one of `options`."""
        return bool(getattr(self, option))

    def toggle(self, option: str) -> None:
        """Change one of `options`."""
        getattr(self, f"toggle_{option}")()

    def show_in(self, detail: Detail) -> None:
        """Draw in this quality from now on; in space."""
        self._target.delete()
        self.detail, self._target = detail, SmoothTarget(detail)

    @property
    def shows_levels(self) -> bool:
        """True if colours are levels, as soon as they are known."""
        return False

    @property
    def light(self) -> np.ndarray:
        """Unit vector (3,) toward the light that casts shadows, in space."""
        return self._scenery.light

    def shine(self, light: np.ndarray) -> None:
        """Set the direction (3,) to the light, a unit vector that points upward; in space."""
        self._scenery.light = light
        for lit in self._lits():
            lit.shine(light)

    def _lits(self) -> list[Shining]:
        """Return everything lit, in space."""
        return [self._lit]

    def show_colliders(self, shown: bool) -> None:
        """Show or hide colliders and their shadows, except planes, in space."""
        self.colliders = self._scenery.shows_colliders = shown

    def upload(self, position: np.ndarray, normal: np.ndarray | None = None) -> None:
        """Send positions (particles, dimensions) [m], with a cloth's normals if they are known; a C-contiguous float32
        array goes without a copy. Raises InputError."""
        self.vertices.upload_state(position, not self.lines, normal)

    def upload_from(self, simulation: Simulation, position: np.ndarray | None = None) -> None:
        """Send the state of a simulation; `position` (particles, dimensions) float32, if the caller has read it already."""
        self.vertices.upload(simulation, not self.lines, position)

    @abstractmethod
    def toggle_lines(self) -> bool:
        """Toggle `lines` and return its new value. Views without a choice change nothing."""

    @property
    def wants_velocity(self) -> bool:
        """True if the drawing needs velocities (for speeds or foam)."""
        return False

    def show_foam(self, points: FoamPoints) -> None:  # noqa: B027 - others have no foam
        """Draw the spray and foam particles `points` of a fluid."""

    def toggle_foam(self) -> bool | None:
        """Show or hide spray, foam and bubbles of fluids. Returns True if they are shown now, None without fluids."""
        return None

    def level_legend(self) -> tuple[str, float] | None:
        """Return (title with its unit, range in that unit) of the colours of levels; None if there are none."""
        return None

    def name_legend(self) -> tuple[tuple[str, tuple[float, float, float]], ...]:
        """Return (name, colour) of everything that has a colour of its own; empty if the colours have no names."""
        return ()

    def know(self, velocity: np.ndarray | None, time: float) -> None:
        """Set the velocities (particles, dimensions) [m/s] or None, and the time [s], of the state that is uploaded
        next. Most views do not use them."""
        self._velocity, self._when = velocity, time

    def pin(self, scene: Scene) -> None:  # noqa: B027 - most views mark no pins
        """Mark the pins of `scene`, the view's scene at another time, from now on."""

    def lower_ground(self, lowest: float) -> None:
        """Move the ground of a scene in space without a plane below `lowest` [m]."""
        if np.isfinite(lowest):
            self.lowest = min(self.lowest, lowest)

    def grounds(self, time: float) -> list[Ground]:
        """Return the grounds that are drawn at `time` [s]; in space."""
        return grounds(self.scene, time, self.lowest)

    def draw(self, camera: Camera, strain_range: float, selected: int | None = None, time: float = 0.0) -> None:
        """Draw the last upload, in space with the colliders at `time` [s]. `strain_range`: the strain at both ends of
        the colour map."""
        from pyglet import gl

        self.pin(self.scene.at(time))
        if self.space:
            coarse = self.detail.coarse
            camera = replace(camera, width=-(-camera.width // coarse), height=-(-camera.height // coarse))
            self._begin_space(camera, time)
        else:
            _blend()
        self._draw_solid(camera, strain_range)
        if self.space:
            if self.detail.shadows:
                self._draw_shadows(camera, time)
            _blend()
            gl.glDepthMask(gl.GL_FALSE)
            self._scenery.draw_ground(camera, time, self.lowest)
        self._draw_over(camera, selected)
        gl.glBindVertexArray(0)
        if self.space:
            gl.glDepthMask(gl.GL_TRUE)
            gl.glDisable(gl.GL_DEPTH_TEST)
            self._target.finish()

    def _begin_space(self, camera: Camera, time: float) -> None:
        """Draw the background in space."""
        from pyglet import gl

        self._target.begin(camera.width, camera.height)
        gl.glClearColor(*colours.BACKGROUND, 1.0)
        gl.glClear(gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
        gl.glEnable(gl.GL_DEPTH_TEST)
        gl.glDepthFunc(gl.GL_LEQUAL)
        gl.glDisable(gl.GL_BLEND)
        self._lit.use(camera)
        self._scenery.draw_colliders(self._lit, time)
        self._lit.program.stop()

    @abstractmethod
    def _draw_solid(self, camera: Camera, strain_range: float) -> None:
        """Draw opaque objects."""

    @abstractmethod
    def _draw_shadows(self, camera: Camera, time: float) -> None:
        """Draw all shadows, through the scenery."""

    @abstractmethod
    def _draw_over(self, camera: Camera, selected: int | None) -> None:
        """Draw transparent objects and marks."""

    def _use_points(self, camera: Camera, array: c_uint) -> None:
        """Use the points of a vertex array from now on; `_style` sets their style."""
        from pyglet import gl

        self._point_program.use()
        self._point_program["transform"] = uniform_matrix(camera.matrix())
        gl.glEnable(gl.GL_PROGRAM_POINT_SIZE)
        gl.glBindVertexArray(array)

    def _style(
        self,
        size: float,
        fill: Sequence[float],
        rim: Sequence[float],
        toward: float,
        square: bool = False,
        hollow: bool = False,
    ) -> None:
        """Set size and colours of points. `size`: pixels of the window."""
        program = self._point_program
        program["point_size"], program["toward"] = size / self.detail.coarse, toward
        program["fill"], program["rim"] = fill, rim
        program["square"], program["hollow"] = int(square), int(hollow)

    def _ring(self, selected: int) -> None:
        """Draw a ring around the selected mass, visible in a fold and inside a body too; the program of points must be
        in use."""
        from pyglet import gl

        gl.glDisable(gl.GL_DEPTH_TEST)
        self._style(RING, colours.SELECTED, colours.SELECTED, 0.0, hollow=True)
        gl.glDrawArrays(gl.GL_POINTS, selected, 1)

    def delete(self) -> None:
        """Free the buffers."""
        if self.space:
            self._scenery.delete()
            self._target.delete()
        self.vertices.delete()


def _blend() -> None:
    """Blend everything that is drawn from now on, by its alpha."""
    from pyglet import gl

    gl.glEnable(gl.GL_BLEND)
    gl.glBlendFunc(gl.GL_SRC_ALPHA, gl.GL_ONE_MINUS_SRC_ALPHA)
