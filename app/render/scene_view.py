"""Draws one world into the current OpenGL context: springs coloured by strain, pins, masses, the selected mass.

The window and the off-screen pictures both draw through here. Plain buffers of OpenGL are used for the masses and not
pyglet's vertex lists, whose element-wise interface takes tens of milliseconds for a large grid; here the upload is one
copy of the (particles, 2) float32 array, or none where the GPU that computes also draws (app/render/cuda_vertices.py).
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from app.render import colours
from app.render.camera import Camera
from app.render.cuda_vertices import CudaVertices
from app.render.opengl import shader_program
from app.render.shaders import POINT_FRAGMENT, SPRING_FRAGMENT, THIN_SPRINGS, VERTEX, WIDE_SPRINGS
from model.core.build import pinned_indices
from model.core.simulation import Simulation
from model.mass_spring.energy import spring_ends
from model.scene.scene import Scene

WIDE_UP_TO = 200_000  # springs: beyond it, plain lines, which software drivers draw much faster
POINTS_FROM = 14.0  # pixels between neighbours from which on the masses are drawn as points
PIN_SIZE = 9.0  # pixels, at least: a pin is always larger than a mass


class SceneView:
    """`scene`'s masses and springs on the graphics card. Needs a current OpenGL 3.3 context, the same in every call.

    `upload(position)` sends a state, `upload_from(simulation)` a simulation's, `draw(camera, strain_range, selected)` draws
    it; `delete()` frees the buffers.
    Raises BackendUnavailable where the driver is too old for it.
    """

    def __init__(self, scene: Scene):
        from pyglet import gl

        self.scene = scene
        self.particles = scene.grid.particle_count
        self.springs = scene.grid.spring_count if scene.springs else 0
        self.wide = self.springs <= WIDE_UP_TO
        geometry = WIDE_SPRINGS if self.wide else THIN_SPRINGS
        self._spring_program = shader_program(VERTEX, SPRING_FRAGMENT, geometry)
        self._point_program = shader_program(VERTEX, POINT_FRAGMENT)
        pins = pinned_indices(scene.grid).astype(np.uint32)
        self.pins = len(pins)
        ends = spring_ends(scene.grid.rows, scene.grid.columns) if self.springs else np.zeros((0, 2), np.int32)
        self.vertices = CudaVertices(scene)
        self._buffers = (gl.GLuint * 2)()  # spring ends, pins
        gl.glGenBuffers(2, self._buffers)
        self._spring_array = self._vertex_array(self._spring_program, self._buffers[0])
        self._point_array = self._vertex_array(self._point_program, self._buffers[1])
        self._fill(self._spring_array, gl.GL_ELEMENT_ARRAY_BUFFER, self._buffers[0], ends)
        self._fill(self._point_array, gl.GL_ELEMENT_ARRAY_BUFFER, self._buffers[1], pins)
        gl.glBindVertexArray(0)
        self._constants()

    def _vertex_array(self, program: Any, elements: int) -> Any:
        from pyglet import gl

        array = gl.GLuint()
        gl.glGenVertexArrays(1, array)
        gl.glBindVertexArray(array)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, self.vertices.position_buffer)
        place = program.attributes["position"]["location"]
        gl.glEnableVertexAttribArray(place)
        gl.glVertexAttribPointer(place, 2, gl.GL_FLOAT, gl.GL_FALSE, 0, None)
        gl.glBindBuffer(gl.GL_ELEMENT_ARRAY_BUFFER, elements)
        return array

    @staticmethod
    def _fill(array: Any, target: int, buffer: int, data: np.ndarray) -> None:
        from pyglet import gl

        gl.glBindVertexArray(array)
        gl.glBindBuffer(target, buffer)
        gl.glBufferData(target, data.nbytes, data.ctypes.data_as(ctypes.c_void_p), gl.GL_STATIC_DRAW)

    def _constants(self) -> None:
        """Uniforms that never change."""
        rest = self.scene.springs.rest_length if self.scene.springs else 0.0
        program = self._spring_program
        program.use()
        program["inverse_rest"] = 1 / (rest or self.scene.grid.spacing)
        program["offset"] = 1.0 if rest else 0.0
        program["stops"] = tuple(tuple(float(part) for part in stop) for stop in colours.STOPS)
        program.stop()

    def upload(self, position: np.ndarray) -> None:
        """Send positions (particles, 2) [m]; a C-contiguous float32 array goes without a copy. Raises InputError."""
        self.vertices.upload_state(position, normals=False)

    def upload_from(self, simulation: Simulation, position: np.ndarray | None = None) -> None:
        """Send the state of a simulation; `position` (particles, 2) float32, if the caller has read it already."""
        self.vertices.upload(simulation, False, position)

    def draw(self, camera: Camera, strain_range: float, selected: int | None = None, time: float = 0.0) -> None:
        """Draw what was uploaded last. `strain_range`: the strain at both ends of the colour map. Nothing here depends on
        the `time`."""
        from pyglet import gl

        gl.glEnable(gl.GL_BLEND)
        gl.glBlendFunc(gl.GL_SRC_ALPHA, gl.GL_ONE_MINUS_SRC_ALPHA)
        gl.glEnable(gl.GL_PROGRAM_POINT_SIZE)
        apart = camera.scale * self.scene.grid.spacing  # pixels
        if self.springs:
            program = self._spring_program
            program.use()
            self._look(program, camera)
            program["strain_range"] = strain_range
            if self.wide:
                program["window"] = (camera.width, camera.height)
            program["half_width"] = min(max(0.05 * apart, 0.6), 2.5) if self.wide else 0.5
            gl.glBindVertexArray(self._spring_array)
            gl.glDrawElements(gl.GL_LINES, 2 * self.springs, gl.GL_UNSIGNED_INT, None)
        program = self._point_program
        program.use()
        self._look(program, camera)
        gl.glBindVertexArray(self._point_array)
        size = min(max(0.28 * apart, 3.0), 16.0)
        if apart >= POINTS_FROM or not self.springs:
            rim = colours.BACKGROUND if size > 5 else colours.INK  # a bright rim would hide a thin spring's ends
            self._style(program, size, colours.INK, rim)
            gl.glDrawArrays(gl.GL_POINTS, 0, self.particles)
        if self.pins:
            rim = colours.BACKGROUND if apart > PIN_SIZE else colours.PIN  # rims of a dense row would hide its pins
            self._style(program, max(PIN_SIZE, size + 4), colours.PIN, rim, square=True)
            gl.glDrawElements(gl.GL_POINTS, self.pins, gl.GL_UNSIGNED_INT, None)
        if selected is not None:
            self._style(program, 22.0, colours.SELECTED, colours.SELECTED, hollow=True)
            gl.glDrawArrays(gl.GL_POINTS, selected, 1)
        program.stop()
        gl.glBindVertexArray(0)

    @staticmethod
    def _look(program: Any, camera: Camera) -> None:
        program["centre"] = (camera.x, camera.y)
        program["scale"] = (2 * camera.scale / camera.width, 2 * camera.scale / camera.height)

    @staticmethod
    def _style(program: Any, size: float, fill: Any, rim: Any, square: bool = False, hollow: bool = False) -> None:
        program["point_size"] = size
        program["fill"], program["rim"] = fill, rim
        program["square"], program["hollow"] = int(square), int(hollow)

    def delete(self) -> None:
        """Free the buffers."""
        from pyglet import gl

        self.vertices.delete()
        gl.glDeleteBuffers(2, self._buffers)
        for array in (self._spring_array, self._point_array):
            gl.glDeleteVertexArrays(1, array)
