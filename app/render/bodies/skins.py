"""The skins of bodies on the graphics card: meshes at rest, and the clusters' matrices that move them."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

import numpy as np

from softlab.app.render.bodies.shaders import ACROSS
from softlab.app.render.vertex_arrays import NORMAL, POSITION, delete_all, static_buffer, vertex_array
from softlab.model.particles.body_set import Copy

if TYPE_CHECKING:
    from pyglet.graphics.shader import ShaderProgram

CLUSTER, WEIGHT = 2, 3  # where the shaders of app/render/bodies/shaders.py look for them


class Skins:
    """The skins of the copies of one body, which have consecutive numbers: one mesh on the graphics card, drawn once
    per copy."""

    def __init__(self, copies: list[Copy]):
        from pyglet import gl

        skin = copies[0].baked.skin
        self.number, self.count = copies[0].number, len(copies)
        self._first, self._each = copies[0].first_cluster, copies[0].baked.clusters.count
        self._elements = skin.triangles.size
        arrays = (skin.position, skin.normal, skin.clusters, skin.weights)
        data = [np.ascontiguousarray(array, np.int32 if array is skin.clusters else np.float32) for array in arrays]
        self._buffers = [static_buffer(part) for part in [*data, skin.triangles.astype(np.uint32)]]
        self._array = vertex_array(self._buffers[POSITION], self._buffers[-1], self._buffers[NORMAL])
        gl.glBindVertexArray(self._array)
        for place in (CLUSTER, WEIGHT):
            gl.glBindBuffer(gl.GL_ARRAY_BUFFER, self._buffers[place])
            gl.glEnableVertexAttribArray(place)
        gl.glVertexAttribPointer(WEIGHT, 4, gl.GL_FLOAT, gl.GL_FALSE, 0, None)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, self._buffers[CLUSTER])
        gl.glVertexAttribIPointer(CLUSTER, 4, gl.GL_INT, 0, None)
        gl.glBindVertexArray(0)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)

    def draw(self, program: ShaderProgram) -> None:
        """Draw the skins with the SKINNING `program`, which must be in use."""
        from pyglet import gl

        program["first"], program["each"] = self._first, self._each
        gl.glBindVertexArray(self._array)
        gl.glDrawElementsInstanced(gl.GL_TRIANGLES, self._elements, gl.GL_UNSIGNED_INT, None, self.count)

    def delete(self) -> None:
        """Free the buffers."""
        delete_all([self._array], self._buffers)


class ClusterTexture:
    """A texture with the matrices of the clusters: three texels of four numbers per cluster."""

    def __init__(self, clusters: int) -> None:
        from pyglet import gl

        self._data = np.zeros((-(-clusters // ACROSS), ACROSS, 3, 4), np.float32)
        self._texture = gl.GLuint()
        gl.glGenTextures(1, self._texture)
        self.bind()
        for name in (gl.GL_TEXTURE_MIN_FILTER, gl.GL_TEXTURE_MAG_FILTER):
            gl.glTexParameteri(gl.GL_TEXTURE_2D, name, gl.GL_NEAREST)

    def send(self, matrices: np.ndarray) -> None:
        """Send matrices (clusters, 3, 4) float32."""
        from pyglet import gl

        self._data.reshape(-1, 3, 4)[: len(matrices)] = matrices
        rows, pointer = len(self._data), self._data.ctypes.data_as(ctypes.c_void_p)
        self.bind()
        gl.glTexImage2D(gl.GL_TEXTURE_2D, 0, gl.GL_RGBA32F, 3 * ACROSS, rows, 0, gl.GL_RGBA, gl.GL_FLOAT, pointer)

    def bind(self) -> None:
        """Bind the texture for the sampler of unit 0."""
        from pyglet import gl

        gl.glActiveTexture(gl.GL_TEXTURE0)
        gl.glBindTexture(gl.GL_TEXTURE_2D, self._texture)

    def delete(self) -> None:
        """Free it."""
        from pyglet import gl

        gl.glDeleteTextures(1, self._texture)
