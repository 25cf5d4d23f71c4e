"""The surface of a fluid in a plane: a level of the sum of the particles' kernels, added up in a coarse picture."""

from __future__ import annotations

import ctypes
from math import pi

from softlab.app.render.camera import Camera2D
from softlab.app.render.fluid.disc_shaders import FIELD_FRAGMENT, FIELD_VERTEX, LEVEL_FRAGMENT, LEVEL_VERTEX
from softlab.app.render.opengl import shader_program
from softlab.app.render.vertex_arrays import draw_squares, uniform_matrix
from softlab.model.base.errors import BackendUnavailable

SUPPORT = 1.8  # rest distances: radius of the kernel (1 - q^2)^3, whose standard deviation is 0.57 of them
MIN_SUPPORT = 2.0  # pixels
DROP = pi**-0.5  # rest distances: radius of a disc of a particle's area
CELLS = 5.0  # of the coarse picture in a support


class PlaneSurface:
    """The surface of `count` particles of an array of `square_array` in a plane; `spacing` [m]: their rest distance.

    `draw(camera)` blends it with the picture, in the viewport that is set; `delete()` frees it. Needs a current OpenGL 3.3
    context. Raises BackendUnavailable if the driver has no float pictures.
    """

    def __init__(self, squares: ctypes.c_uint, count: int, spacing: float):
        from pyglet import gl

        self._squares, self._count, self._spacing = squares, count, spacing
        self._field = shader_program(FIELD_VERTEX, FIELD_FRAGMENT)
        self._level = shader_program(LEVEL_VERTEX, LEVEL_FRAGMENT)
        self._size = (0, 0)
        self._frame, self._picture, self._empty = gl.GLuint(), gl.GLuint(), gl.GLuint()
        gl.glGenFramebuffers(1, self._frame)
        gl.glGenTextures(1, self._picture)
        gl.glGenVertexArrays(1, self._empty)

    def draw(self, camera: Camera2D) -> None:
        """Draw the surface."""
        from pyglet import gl

        bound, box = gl.GLint(), (gl.GLint * 4)()
        gl.glGetIntegerv(gl.GL_DRAW_FRAMEBUFFER_BINDING, bound)
        gl.glGetIntegerv(gl.GL_VIEWPORT, box)
        support = max(SUPPORT * self._spacing, MIN_SUPPORT / camera.scale)
        peak = 4.0 / pi * (self._spacing / support) ** 2  # of a kernel whose sum over a square lattice is about 1
        level = peak * (1.0 - (DROP * self._spacing / support) ** 2) ** 3  # a drop alone covers its particle's area
        cell = max(support * camera.scale / CELLS, 1.0)  # pixels
        size = int(-(-camera.width // cell)), int(-(-camera.height // cell))
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._frame)
        if size != self._size:
            self._allocate(size)
        gl.glViewport(0, 0, *size)
        gl.glClearColor(0.0, 0.0, 0.0, 0.0)
        gl.glClear(gl.GL_COLOR_BUFFER_BIT)
        gl.glBlendFunc(gl.GL_ONE, gl.GL_ONE)
        self._field.use()
        self._field["transform"] = uniform_matrix(camera.matrix())
        self._field["support"], self._field["peak"] = support, peak
        draw_squares(self._squares, self._count)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, int(bound.value))
        gl.glViewport(*box)
        gl.glBlendFunc(gl.GL_SRC_ALPHA, gl.GL_ONE_MINUS_SRC_ALPHA)
        self._level.use()
        self._level["level"] = level
        gl.glBindTexture(gl.GL_TEXTURE_2D, self._picture)
        gl.glBindVertexArray(self._empty)
        gl.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self._level.stop()

    def _allocate(self, size: tuple[int, int]) -> None:
        from pyglet import gl

        self._size = size
        gl.glBindTexture(gl.GL_TEXTURE_2D, self._picture)
        gl.glTexImage2D(gl.GL_TEXTURE_2D, 0, gl.GL_RGBA32F, *size, 0, gl.GL_RGBA, gl.GL_FLOAT, None)
        for name in (gl.GL_TEXTURE_MIN_FILTER, gl.GL_TEXTURE_MAG_FILTER):
            gl.glTexParameteri(gl.GL_TEXTURE_2D, name, gl.GL_LINEAR)
        for name in (gl.GL_TEXTURE_WRAP_S, gl.GL_TEXTURE_WRAP_T):
            gl.glTexParameteri(gl.GL_TEXTURE_2D, name, gl.GL_CLAMP_TO_EDGE)
        gl.glFramebufferTexture2D(gl.GL_FRAMEBUFFER, gl.GL_COLOR_ATTACHMENT0, gl.GL_TEXTURE_2D, self._picture, 0)
        status = gl.glCheckFramebufferStatus(gl.GL_FRAMEBUFFER)
        if status != gl.GL_FRAMEBUFFER_COMPLETE:
            raise BackendUnavailable(
                f"the OpenGL driver refuses pictures of 32-bit floats (status {status:#x})",
                "install a driver with OpenGL 3.3 or newer, or show the fluid as particles",
            )

    def delete(self) -> None:
        """Free the picture."""
        from pyglet import gl

        gl.glDeleteFramebuffers(1, self._frame)
        gl.glDeleteTextures(1, self._picture)
        gl.glDeleteVertexArrays(1, self._empty)
