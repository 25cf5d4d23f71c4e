"""Particles as lit spheres, exact per pixel, and their shadows."""

from __future__ import annotations

from collections.abc import Iterable
from ctypes import c_uint
from typing import TYPE_CHECKING

import numpy as np

from softlab.app.render.bodies import shaders as body_shaders
from softlab.app.render.camera import Camera
from softlab.app.render.opengl import shader_program
from softlab.app.render.scenery import KEY, Lit, Scenery
from softlab.app.render.vertex_arrays import draw_squares, uniform_matrix

if TYPE_CHECKING:
    from pyglet.graphics.shader import ShaderProgram

SHINE = 0.10
Balls = tuple[c_uint, int, float]  # an array of `square_array`, how many, what is drawn of each one's radius


class Spheres:
    """`draw(camera, ...)` and `shade(camera, flatten, centre, ...)`, of arrays of `square_array`. Needs a current OpenGL 3.3
    context."""

    def __init__(self, scenery: Scenery):
        self._lit = Lit(body_shaders.SPHERE_VERTEX, body_shaders.SPHERE_FRAGMENT)
        self._shadow = shader_program(body_shaders.SPHERE_SHADOW_VERTEX, body_shaders.SPHERE_SHADOW_FRAGMENT)
        self._lit.program.use()
        self._lit.program["shine"] = SHINE
        self._lit.program.stop()
        scenery.shadow_constants(self._shadow)
        self.shine(KEY)

    def shine(self, light: np.ndarray) -> None:
        """Set the direction to the light. The shadow of a sphere is that of its disc across the light."""
        self._lit.shine(light)
        side = np.cross(light, (0.0, 0.0, 1.0))
        side /= np.linalg.norm(side)
        self._shadow.use()
        self._shadow["side"], self._shadow["other"] = tuple(side), tuple(np.cross(light, side))
        self._shadow.stop()

    def draw(self, camera: Camera, smooth: bool, balls: Iterable[Balls]) -> None:
        """Draw the spheres. `smooth`: the picture has several samples per pixel."""
        from pyglet import gl

        program = self._lit.program
        self._lit.use(camera)
        program["upward"] = tuple(camera.axes[1].tolist())
        program["least"] = 0.0 if smooth else 0.5
        if smooth:
            gl.glEnable(gl.GL_SAMPLE_ALPHA_TO_COVERAGE)
        for array, count, size in balls:
            program["size"] = size
            draw_squares(array, count)
        gl.glDisable(gl.GL_SAMPLE_ALPHA_TO_COVERAGE)
        program.stop()

    def shade(self, camera: Camera, flatten: np.ndarray, centre: np.ndarray, balls: Balls) -> None:
        """Draw the shadows of spheres (see Scenery.draw_shadows)."""
        array, count, size = balls
        use_shadow(self._shadow, camera, flatten, centre)
        self._shadow["size"] = size
        draw_squares(array, count)
        self._shadow.stop()


def use_shadow(program: ShaderProgram, camera: Camera, flatten: np.ndarray, centre: np.ndarray) -> None:
    """Use the shader program of shadows from now on."""
    program.use()
    program["transform"], program["flatten"] = uniform_matrix(camera.matrix()), uniform_matrix(flatten)
    program["centre"] = tuple(centre.tolist())
