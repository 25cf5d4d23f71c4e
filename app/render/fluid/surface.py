"""A fluid's surface in screen space, without a mesh.

W. van der Laan, S. Green, M. Sainz, "Screen Space Fluid Rendering with Curvature Flow", I3D 2009. In passes, each a picture:

1. depth: particles as balls or as ellipsoids (J. Yu, G. Turk, ACM TOG 32 (2013): model/geometry/anisotropy.py), the nearest
   point at each pixel, as distance along the line of view in 32-bit float;
2. outline: where a bell over what is covered is above a level, so that it is a curve and not the edge of balls;
3. filter, on and on between two pictures: `narrow-range` (N. Truong, C. Yuksel 2018), or `none`;
4. thickness: how long the line of sight is inside of particles, summed;
5. shading: normals from differences of depth, what is behind seen through the fluid, reflected sky, sun.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence

import numpy as np

from softlab.app.render.camera3d import FARTHEST, Camera3D
from softlab.app.render.fluid import filter_shaders, shaders
from softlab.app.render.fluid.pictures import (
    BEHIND,
    BEHIND_DEPTH,
    DEPTH,
    NORMALS,
    OTHER_DEPTH,
    OUTLINE,
    THICKNESS,
    FluidPictures,
)
from softlab.app.render.opengl import shader_program
from softlab.app.render.scenery import KEY
from softlab.app.render.vertex_arrays import APPEARANCE, POSITION, uniform_matrix
from softlab.model.base.errors import InputError

FILTERS = ("narrow-range", "none")
BACK = 5  # where shaders look for the first row of an ellipsoid's inverse
HALF_WIDTH, RANGE, BEYOND = 3.0, 3.5, 0.6  # of the filter, in radii: half width, range, smallest depth step that counts
BLUR = 3.0  # radii: half width of that of thickness
ALONG = ((1, 0), (0, 1))
_NARROW = {"range": RANGE, "behind": BEYOND}
# Of each filter: its passes, as a program, an axis and lengths in radii.
STEPS: dict[str, list[tuple[str, tuple[int, int] | None, dict[str, float]]]] = {
    "narrow-range": [
        *(
            ("narrow-range", axis, _NARROW | {"half_width": HALF_WIDTH * 0.5**turn})
            for turn in range(2)
            for axis in ALONG
        ),
        ("clean", None, _NARROW),
    ],
    "none": [],
}
ROUND, FINEST = 1.1, 2.0  # the bell that rounds outlines: its standard deviation in radii, at least in cells of pixels
APART = 4.0  # radii: what is so far behind one another (standard deviation) does not close gaps
OVERLAP = 0.6  # of a ray's path through a particle: balls of half a spacing and more overlap
ZENITH, HORIZON, FLOOR = (0.30, 0.50, 0.78), (0.88, 0.92, 0.96), (0.55, 0.60, 0.63)
WATER = (2.6, 1.05, 0.35)  # 1/m of red, green, blue: bluer than water is, whose metre is hardly seen
BEND = 0.25
EDGE = 2.0  # radii: how far before a solid a fluid is seen in full, so that it ends softly where it touches one


class FluidSurface:
    """The surface of `count` particles whose positions (count, 3) float32 [m] lie in an OpenGL buffer.

    `set_appearance(radius, absorption, axes)`, then for each frame `passes(camera)` and `shade(camera, target)`;
    `normals(camera)` returns normals and depth as arrays. Needs a current OpenGL 3.3 context, the same in every call;
    `delete()` frees all. Raises BackendUnavailable if the driver has no float pictures, InputError for a filter that is
    not one of FILTERS.
    """

    def __init__(self, position_buffer: int, count: int, filtered: str = FILTERS[0]):
        if filtered not in FILTERS:
            raise InputError(f"filter {filtered!r}: must be one of {', '.join(FILTERS)}")
        from pyglet import gl

        self.count, self.filtered = count, filtered
        self._radius, self._light = 1.0, KEY
        self._programs = {
            name: shader_program(vertex, fragment)
            for name, vertex, fragment in (
                ("depth", shaders.ELLIPSOID_VERTEX, shaders.DEPTH_FRAGMENT),
                ("thickness", shaders.ELLIPSOID_VERTEX, shaders.THICKNESS_FRAGMENT.replace("OVERLAP", str(OVERLAP))),
                ("gather", shaders.SCREEN_VERTEX, filter_shaders.GATHER_FRAGMENT),
                ("bell", shaders.SCREEN_VERTEX, filter_shaders.BELL_FRAGMENT),
                ("outline", shaders.SCREEN_VERTEX, filter_shaders.OUTLINE_FRAGMENT),
                ("narrow-range", shaders.SCREEN_VERTEX, filter_shaders.NARROW_FRAGMENT),
                ("clean", shaders.SCREEN_VERTEX, filter_shaders.CLEAN_FRAGMENT),
                ("blur", shaders.SCREEN_VERTEX, filter_shaders.BLUR_FRAGMENT),
                ("normal", shaders.SCREEN_VERTEX, shaders.NORMAL_FRAGMENT),
                ("shade", shaders.SCREEN_VERTEX, shaders.SHADE_FRAGMENT),
            )
        }
        self._pictures = FluidPictures()
        self._appearances = (gl.GLuint * 2)()
        gl.glGenBuffers(2, self._appearances)
        self._array = self._particles(position_buffer)
        self._result = DEPTH  # which picture holds the depth that counts

    def _particles(self, position_buffer: int) -> ctypes.c_uint:
        from pyglet import gl

        array = gl.GLuint()
        gl.glGenVertexArrays(1, array)
        gl.glBindVertexArray(array)
        rows = [(BACK + row, self._appearances[1], 3, 36, 12 * row) for row in range(3)]
        for place, buffer, size, stride, start in [
            (POSITION, position_buffer, 3, 0, 0), (APPEARANCE, self._appearances[0], 4, 0, 0), *rows
        ]:  # fmt: skip
            gl.glBindBuffer(gl.GL_ARRAY_BUFFER, buffer)
            gl.glEnableVertexAttribArray(place)
            gl.glVertexAttribPointer(place, size, gl.GL_FLOAT, gl.GL_FALSE, stride, ctypes.c_void_p(start))
            gl.glVertexAttribDivisor(place, 1)
        gl.glBindVertexArray(0)
        return array

    @property
    def appearance_buffer(self) -> int:
        """OpenGL buffer (count, 4) float32: absorption [1/m], and radius of the ball about each ellipsoid [m]."""
        return int(self._appearances[0])

    def shine(self, light: np.ndarray) -> None:
        """Set the direction (3,) to the sun, a unit vector."""
        self._light = light

    # ------------------------------------------------------------------ the particles

    def set_appearance(
        self, radius: float, absorption: Sequence[float] | np.ndarray = WATER, axes: np.ndarray | None = None
    ) -> None:
        """Draw particles as balls of `radius` [m], or as the images of the unit ball under `axes` (count, 3, 3) [m].

        `absorption` (3,) or (count, 3) [1/m]: absorption of red, green and blue light per metre of fluid (Beer and
        Lambert).
        """
        self._radius = radius
        appearance = np.empty((self.count, 4), np.float32)
        appearance[:, :3] = absorption
        back = np.empty((self.count, 3, 3), np.float32)
        if axes is None:
            appearance[:, 3], back[:] = radius, np.eye(3) / radius
        else:
            appearance[:, 3], back[:] = np.linalg.norm(axes, ord=2, axis=(1, 2)), np.linalg.inv(axes)
        self._fill(0, appearance)
        self._fill(1, back)

    def _fill(self, which: int, data: np.ndarray) -> None:
        from pyglet import gl

        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, self._appearances[which])
        gl.glBufferData(gl.GL_ARRAY_BUFFER, data.nbytes, data.ctypes.data_as(ctypes.c_void_p), gl.GL_DYNAMIC_DRAW)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)

    # ------------------------------------------------------------------ pictures

    def _balls(self, name: str, camera: Camera3D) -> None:
        from pyglet import gl

        program = self._programs[name]
        program.use()
        program["transform"], program["eye"] = uniform_matrix(camera.matrix()), tuple(camera.eye.tolist())
        program["upward"] = tuple(camera.axes[1].tolist())
        program["ahead"] = tuple(camera.ahead.tolist())
        if name == "thickness":
            program["planes"] = (camera.nearest, FARTHEST * camera.distance)
            self._pictures.bind(others=BEHIND_DEPTH)
        gl.glBindVertexArray(self._array)
        gl.glDrawArraysInstanced(gl.GL_TRIANGLE_STRIP, 0, 4, self.count)
        gl.glBindVertexArray(0)
        program.stop()

    # ------------------------------------------------------------------ the passes

    def passes(self, camera: Camera3D, frame: int | None = None) -> None:
        """Compute the filtered depth and the thickness of the particles in the buffer.

        The picture and the depth in the frame buffer `frame`, of the camera's size, hide particles behind them; without
        `frame` nothing does. The bound frame buffer and its tests are restored.
        """
        from pyglet import gl

        bound, box, writes = gl.GLint(), (gl.GLint * 4)(), gl.GLboolean()
        on = [gl.glIsEnabled(what) for what in (gl.GL_DEPTH_TEST, gl.GL_BLEND)]
        gl.glGetIntegerv(gl.GL_DRAW_FRAMEBUFFER_BINDING, bound)
        gl.glGetIntegerv(gl.GL_VIEWPORT, box)
        gl.glGetBooleanv(gl.GL_DEPTH_WRITEMASK, writes)
        self._pictures.resize(camera.width, camera.height)
        gl.glDepthMask(gl.GL_TRUE)
        self._pictures.copy_from(frame)
        gl.glEnable(gl.GL_DEPTH_TEST)
        gl.glDisable(gl.GL_BLEND)
        self._pictures.begin(DEPTH)
        self._balls("depth", camera)
        gl.glDisable(gl.GL_DEPTH_TEST)
        self._outline(camera)
        self._filter(camera)
        gl.glEnable(gl.GL_BLEND)
        gl.glBlendFunc(gl.GL_ONE, gl.GL_ONE)
        self._pictures.begin(THICKNESS)
        self._balls("thickness", camera)
        gl.glDisable(gl.GL_BLEND)
        self._blur(camera)
        gl.glBlendFunc(gl.GL_SRC_ALPHA, gl.GL_ONE_MINUS_SRC_ALPHA)
        for what, before in zip((gl.GL_DEPTH_TEST, gl.GL_BLEND), on, strict=True):
            (gl.glEnable if before else gl.glDisable)(what)
        gl.glDepthMask(writes)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, int(bound.value))
        gl.glViewport(*box)

    def _blur(self, camera: Camera3D) -> None:
        """Blur the thickness, with the picture of normals as scratch."""
        lengths: dict[str, object] = {"half_width": BLUR * self._radius, "focal": camera.focal}
        for source, goal, axis in ((THICKNESS, NORMALS, (1, 0)), (NORMALS, THICKNESS, (0, 1))):
            self._draw("blur", goal, {"thickness": source, "depth": self._result}, lengths | {"axis": axis})

    def _draw(
        self,
        name: str,
        goal: int,
        pictures: dict[str, int],
        values: Mapping[str, object],
        size: tuple[int, int] | None = None,
    ) -> None:
        """Run a program for every pixel of the target `goal`, or of its first `size` pixels. It reads the textures
        `pictures` and `values` by the names of their samplers and uniforms."""
        program = self._programs[name]
        self._pictures.onto(goal, size)
        program.use()
        for unit, sampler in enumerate(pictures):
            program[sampler] = unit
        for uniform, value in values.items():
            program[uniform] = value
        self._pictures.bind(**pictures)
        self._pictures.screen()
        program.stop()

    def _outline(self, camera: Camera3D) -> None:
        """Close the gaps between the outermost particles; computes the depth there, and the covered fraction of each
        pixel."""
        pixels = ROUND * self._radius * camera.scale
        cell = max(int(pixels / FINEST), 1)
        size, wide = (-(-camera.width // cell), -(-camera.height // cell)), max(pixels / cell, 0.5)
        last = size[0] - 1, size[1] - 1
        self._draw("gather", NORMALS, {"depth": DEPTH}, {"cell": cell}, size)
        for source, goal, axis in ((NORMALS, THICKNESS, (1, 0)), (THICKNESS, NORMALS, (0, 1))):
            self._draw("bell", goal, {"cells": source}, {"axis": axis, "last": last, "wide": wide}, size)
        how: dict[str, object] = {"cell": cell, "last": last, "wide": wide, "apart": APART * self._radius}
        self._draw("outline", OUTLINE, {"depth": DEPTH, "cells": NORMALS}, how)

    def _filter(self, camera: Camera3D) -> None:
        """Smooth the depth, alternating between the first two pictures; `_result` is the last one."""
        self._result = OUTLINE
        for name, axis, lengths in STEPS[self.filtered]:
            goal = OTHER_DEPTH if self._result == DEPTH else DEPTH
            values: dict[str, object] = {uniform: length * self._radius for uniform, length in lengths.items()}
            values |= {"axis": axis} if axis else {}
            values |= {"focal": camera.focal} if "focal" in self._programs[name].uniforms else {}
            self._draw(name, goal, {"depth": self._result}, values)
            self._result = goal

    def normals(self, camera: Camera3D) -> np.ndarray:
        """Return (height, width, 4) float32, top row first, of the last `passes`: the normal in the camera's axes
        (right, up, back), and the depth [m]; 0 where there is no fluid."""
        from pyglet import gl

        bound, box = gl.GLint(), (gl.GLint * 4)()
        gl.glGetIntegerv(gl.GL_DRAW_FRAMEBUFFER_BINDING, bound)
        gl.glGetIntegerv(gl.GL_VIEWPORT, box)
        gl.glDisable(gl.GL_BLEND)
        self._draw("normal", NORMALS, {"depth": self._result}, self._place(camera))
        image = np.empty((camera.height, camera.width, 4), np.float32)
        gl.glReadPixels(
            0, 0, camera.width, camera.height, gl.GL_RGBA, gl.GL_FLOAT, image.ctypes.data_as(ctypes.c_void_p)
        )
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, int(bound.value))
        gl.glViewport(*box)
        return image[::-1]

    @staticmethod
    def _place(camera: Camera3D) -> dict[str, object]:
        return {"focal": camera.focal, "middle": (camera.width / 2, camera.height / 2)}

    def shade(self, camera: Camera3D, frame: int) -> None:
        """Draw the surface of the last `passes` into this frame buffer, which stays bound."""
        from pyglet import gl

        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, frame)
        gl.glDisable(gl.GL_DEPTH_TEST)
        gl.glDisable(gl.GL_BLEND)
        program = self._programs["shade"]
        program.use()
        for name, value in self._place(camera).items():
            program[name] = value
        pictures = {
            "depth": self._result, "thickness": THICKNESS, "behind": BEHIND, "others": BEHIND_DEPTH, "outline": OUTLINE
        }  # fmt: skip
        for unit, name in enumerate(pictures):
            program[name] = unit
        program["planes"] = (camera.nearest, FARTHEST * camera.distance)
        program["axes"], program["key"] = tuple(camera.axes.ravel().tolist()), tuple(self._light.tolist())
        program["edge"] = EDGE * self._radius
        program["bend"], program["zenith"], program["horizon"], program["floor_colour"] = BEND, ZENITH, HORIZON, FLOOR
        self._pictures.bind(**pictures)
        self._pictures.screen()
        program.stop()

    def bind_depth(self) -> None:
        """Bind the depth of the last `passes` to the only sampler of the program in use."""
        self._pictures.bind(depth=self._result)

    def delete(self) -> None:
        """Free everything."""
        from pyglet import gl

        self._pictures.delete()
        gl.glDeleteBuffers(2, self._appearances)
        gl.glDeleteVertexArrays(1, self._array)
