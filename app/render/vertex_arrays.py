"""Helpers for OpenGL: fill a buffer once, describe its vertices, set a matrix."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np

POSITION, NORMAL = 0, 1  # where shaders look for them
APPEARANCE = 4  # likewise, those of app/render/bodies/shaders.py


def static_buffer(data: np.ndarray) -> int:
    """Return a buffer with `data` (C-contiguous) that is rarely or never written again."""
    from pyglet import gl

    buffer = gl.GLuint()
    gl.glGenBuffers(1, buffer)
    gl.glBindBuffer(gl.GL_ARRAY_BUFFER, buffer)
    gl.glBufferData(gl.GL_ARRAY_BUFFER, data.nbytes, data.ctypes.data_as(ctypes.c_void_p), gl.GL_STATIC_DRAW)
    gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)
    return int(buffer.value)


def refill(buffer: int, data: np.ndarray) -> None:
    """Put `data` (C-contiguous) in place of the same number of bytes."""
    from pyglet import gl

    gl.glBindBuffer(gl.GL_ARRAY_BUFFER, buffer)
    gl.glBufferSubData(gl.GL_ARRAY_BUFFER, 0, data.nbytes, data.ctypes.data_as(ctypes.c_void_p))
    gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)


def _array_of(sources: list[tuple[int, int, int]], elements: int | None = None) -> ctypes.c_uint:
    """Return a vertex array of (location, buffer, numbers per vertex), float32; without `elements` a vertex is an
    instance."""
    from pyglet import gl

    array = gl.GLuint()
    gl.glGenVertexArrays(1, array)
    gl.glBindVertexArray(array)
    for place, buffer, size in sources:
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, buffer)
        gl.glEnableVertexAttribArray(place)
        gl.glVertexAttribPointer(place, size, gl.GL_FLOAT, gl.GL_FALSE, 0, None)
        if elements is None:
            gl.glVertexAttribDivisor(place, 1)
    if elements is not None:
        gl.glBindBuffer(gl.GL_ELEMENT_ARRAY_BUFFER, elements)
    gl.glBindVertexArray(0)
    gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)
    return array


def vertex_array(
    position: int, elements: int, normal: int | None = None, dimensions: int = 3, colour: int | None = None
) -> ctypes.c_uint:
    """Return a vertex array of (vertices, dimensions) float32 buffers, drawn in the order of the buffer `elements`;
    `colour`: of each vertex (vertices, 3)."""
    normals = [] if normal is None else [(NORMAL, normal, dimensions)]
    appearances = [] if colour is None else [(APPEARANCE, colour, 3)]
    return _array_of([(POSITION, position, dimensions), *normals, *appearances], elements)


def square_array(position: int, appearance: int, dimensions: int = 3) -> ctypes.c_uint:
    """Return a vertex array of one square per vertex: (vertices, dimensions) positions, and colours and sizes
    (vertices, 4); float32."""
    return _array_of([(POSITION, position, dimensions), (APPEARANCE, appearance, 4)])


def point_array(position: int, appearance: int, dimensions: int = 3) -> ctypes.c_uint:
    """Return a vertex array of points: (vertices, dimensions) positions, and colours with alpha (vertices, 4);
    float32."""
    from pyglet import gl

    array = square_array(position, appearance, dimensions)
    gl.glBindVertexArray(array)
    for place in (POSITION, APPEARANCE):
        gl.glVertexAttribDivisor(place, 0)
    gl.glBindVertexArray(0)
    return array


def draw_elements(array: ctypes.c_uint, mode: int, count: int) -> None:
    """Draw `count` elements of a vertex array."""
    from pyglet import gl

    gl.glBindVertexArray(array)
    gl.glDrawElements(mode, count, gl.GL_UNSIGNED_INT, None)


def draw_squares(array: ctypes.c_uint, count: int) -> None:
    """Draw `count` squares of `square_array`."""
    from pyglet import gl

    gl.glBindVertexArray(array)
    gl.glDrawArraysInstanced(gl.GL_TRIANGLE_STRIP, 0, 4, count)


def uniform_matrix(matrix: np.ndarray) -> tuple[float, ...]:
    """Return a (4, 4) matrix in OpenGL's form: column by column."""
    return tuple(matrix.T.ravel().tolist())


def delete_all(arrays: Sequence[ctypes.c_uint], buffers: list[int]) -> None:
    """Free vertex arrays and buffers."""
    from pyglet import gl

    for array in arrays:
        gl.glDeleteVertexArrays(1, array)
    if buffers:
        gl.glDeleteBuffers(len(buffers), (gl.GLuint * len(buffers))(*buffers))
