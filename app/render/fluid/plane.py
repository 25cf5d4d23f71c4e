"""Draws a fluid in a plane: its particles as discs, and the outlines of its colliders."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.app.render import colours, shaders
from softlab.app.render.fluid.disc_shaders import DISC_FRAGMENT, DISC_VERTEX
from softlab.app.render.fluid.outlines import outlines
from softlab.app.render.opengl import shader_program
from softlab.app.render.vertex_arrays import (
    delete_all,
    draw_elements,
    draw_squares,
    square_array,
    static_buffer,
    uniform_matrix,
    vertex_array,
)
from softlab.app.render.vertices import HostVertices
from softlab.model.scene.scene import Scene


class PlaneFluid:
    """Draws a fluid in a plane from two OpenGL buffers: positions (particles, 2) float32 [m], and appearances
    (particles, 4), colour and radius [m]. Needs a current OpenGL 3.3 context."""

    def __init__(self, scene: Scene, position: int, appearance: int):
        self.scene, self._count = scene, scene.grid.particle_count
        self._discs = square_array(position, appearance, 2)
        self._disc_program = shader_program(DISC_VERTEX, DISC_FRAGMENT)
        self._line_program = shader_program(shaders.VERTEX, shaders.LINE_FRAGMENT)
        lines = outlines(scene, 0.0)
        self._buffers = [static_buffer(lines), static_buffer(np.arange(len(lines), dtype=np.uint32))]
        self._outlines = vertex_array(self._buffers[0], self._buffers[1], dimensions=2)

    def draw_particles(self, camera: Any) -> None:
        """Draw the discs."""
        program = self._disc_program
        program.use()
        program["transform"], program["pixels"] = uniform_matrix(camera.matrix()), camera.scale
        draw_squares(self._discs, self._count)
        program.stop()

    def draw_colliders(self, camera: Any, time: float) -> None:
        """Draw the outlines at `time` [s]."""
        from pyglet import gl

        lines = outlines(self.scene, time)
        HostVertices.send(self._buffers[0], lines)
        program = self._line_program
        program.use()
        program["transform"], program["toward"], program["colour"] = uniform_matrix(camera.matrix()), 0.0, colours.FAINT
        draw_elements(self._outlines, gl.GL_LINES, len(lines))
        program.stop()

    def delete(self) -> None:
        """Free the buffers."""
        delete_all([self._discs, self._outlines], self._buffers)
