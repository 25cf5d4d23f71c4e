"""Positions of masses and normals of a cloth in vertex buffers, updated for each frame.

A view draws from `position_buffer` and `normal_buffer`, whoever filled them. `HostVertices` fills them from the host's
memory; `CudaVertices` (app/render/cuda_vertices.py) lets a GPU backend write into them where it can.
"""

from __future__ import annotations

import ctypes

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import Scene


class HostVertices:
    """Two vertex buffers of (particles, dimensions) float32, one copy each per frame; normals only in space. Needs a
    current OpenGL 3.3 context.

    `transfer`: path of a state into the buffers, in words for the window.
    """

    transfer = "through the host's memory"

    def __init__(self, scene: Scene):
        from pyglet import gl

        self.scene, self.flat = scene, scene.dimensions == 2
        shape = (scene.grid.particle_count, scene.dimensions)
        self._position = np.zeros(shape, np.float32)
        self._normal = np.zeros((0, 3) if self.flat else shape, np.float32)
        self._buffers = (gl.GLuint * 2)()
        gl.glGenBuffers(2, self._buffers)
        self.position_buffer, self.normal_buffer = int(self._buffers[0]), int(self._buffers[1])
        self.send(self.position_buffer, self._position)  # something lies there before the first state comes
        self.send(self.normal_buffer, self._normal)

    def straight(self, simulation: Simulation) -> bool:
        """Return True if `upload` gets the simulation's state without the host, so that it need not be read."""
        return False

    def upload(self, simulation: Simulation, normals: bool = True, position: np.ndarray | None = None) -> None:
        """Upload the current state of `simulation`.

        `normals` False: only lines will be drawn. `position` (particles, dimensions) float32: positions that the caller
        has already read.
        """
        if position is None:
            with np.errstate(over="ignore", invalid="ignore"):  # a float64 world on its way out of float32
                position = simulation.read("position", into=self._position)
        self.send(self.position_buffer, position)
        if normals:
            self.send(self.normal_buffer, simulation.read("normal", into=self._normal))

    def upload_state(self, position: np.ndarray, normals: bool = True, normal: np.ndarray | None = None) -> None:
        """Upload positions (particles, dimensions) [m] without an open simulation, with unit normals if known. Raises
        InputError for a wrong shape."""
        if position.shape != self._position.shape:
            raise InputError(f"position has shape {position.shape}, this scene needs {self._position.shape}")
        self.send(self.position_buffer, position)
        if normals and normal is None:
            with np.errstate(over="ignore", invalid="ignore"):
                normal = self.scene.grid.normals(position)
        if normals and normal is not None:
            self.send(self.normal_buffer, normal)

    @staticmethod
    def send(buffer: int, array: np.ndarray, usage: int | None = None) -> None:
        """Upload `array` into a new store of `buffer`: the driver need not wait for the drawing of the last frame.
        `usage` None: the host writes it every frame."""
        from pyglet import gl

        with np.errstate(over="ignore", invalid="ignore"):
            data = np.ascontiguousarray(array, dtype=np.float32)
        kind = gl.GL_STREAM_DRAW if usage is None else usage
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, buffer)
        gl.glBufferData(gl.GL_ARRAY_BUFFER, data.nbytes, data.ctypes.data_as(ctypes.c_void_p), kind)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)

    def delete(self) -> None:
        """Free the buffers."""
        from pyglet import gl

        gl.glDeleteBuffers(2, self._buffers)
