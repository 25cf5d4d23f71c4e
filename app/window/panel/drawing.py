"""Draws the triangles of Dear ImGui, clipped to rectangles, with pyglet's OpenGL, so that no second binding to OpenGL
is needed."""

from __future__ import annotations

from ctypes import c_void_p
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from softlab.app.render.opengl import shader_program

if TYPE_CHECKING:
    from imgui_bundle.imgui import ImTextureData

VERTEX = """#version 330 core
layout(location = 0) in vec2 place;
layout(location = 1) in vec2 within;
layout(location = 2) in vec4 colour;
uniform vec2 size;          // pixels of the window
out vec2 texel;
out vec4 tint;
void main() {
    texel = within;
    tint = colour;
    gl_Position = vec4(2.0 * place.x / size.x - 1.0, 1.0 - 2.0 * place.y / size.y, 0.0, 1.0);
}
"""
FRAGMENT = """#version 330 core
in vec2 texel;
in vec4 tint;
uniform sampler2D glyphs;
out vec4 pixel;
void main() { pixel = tint * texture(glyphs, texel); }
"""


class Drawing:
    """The buffers and textures of the panel. Needs the window's OpenGL 3.3 context, the same in every call."""

    def __init__(self, imgui: ModuleType):
        from pyglet import gl

        self._imgui = imgui
        self._program = shader_program(VERTEX, FRAGMENT)
        names = (gl.GLuint * 2)()
        gl.glGenBuffers(2, names)
        self._vertices, self._elements = names[0], names[1]
        array = gl.GLuint()
        gl.glGenVertexArrays(1, array)
        self._array = array
        gl.glBindVertexArray(array)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, self._vertices)
        gl.glBindBuffer(gl.GL_ELEMENT_ARRAY_BUFFER, self._elements)
        parts = (
            (2, gl.GL_FLOAT, gl.GL_FALSE, imgui.VERTEX_BUFFER_POS_OFFSET),
            (2, gl.GL_FLOAT, gl.GL_FALSE, imgui.VERTEX_BUFFER_UV_OFFSET),
            (4, gl.GL_UNSIGNED_BYTE, gl.GL_TRUE, imgui.VERTEX_BUFFER_COL_OFFSET),
        )
        for place, (count, kind, normed, offset) in enumerate(parts):
            gl.glEnableVertexAttribArray(place)
            gl.glVertexAttribPointer(place, count, kind, normed, imgui.VERTEX_SIZE, c_void_p(offset))
        gl.glBindVertexArray(0)

    def draw(self, width: int, height: int) -> None:
        """Draw the last frame of Dear ImGui over a window of `width` x `height` pixels."""
        from pyglet import gl

        imgui = self._imgui
        for texture in imgui.get_platform_io().textures:
            if texture.status != imgui.ImTextureStatus.ok:
                self._renew(texture)
        gl.glViewport(0, 0, width, height)
        gl.glDisable(gl.GL_DEPTH_TEST)
        gl.glDisable(gl.GL_CULL_FACE)
        gl.glEnable(gl.GL_BLEND)
        gl.glBlendFunc(gl.GL_SRC_ALPHA, gl.GL_ONE_MINUS_SRC_ALPHA)
        gl.glEnable(gl.GL_SCISSOR_TEST)
        gl.glActiveTexture(gl.GL_TEXTURE0)
        self._program.use()
        self._program["size"] = float(width), float(height)
        gl.glBindVertexArray(self._array)
        index = gl.GL_UNSIGNED_SHORT if imgui.INDEX_SIZE == 2 else gl.GL_UNSIGNED_INT
        for part in imgui.get_draw_data().cmd_lists:
            for target, name, data, size in (
                (gl.GL_ARRAY_BUFFER, self._vertices, part.vtx_buffer, imgui.VERTEX_SIZE),
                (gl.GL_ELEMENT_ARRAY_BUFFER, self._elements, part.idx_buffer, imgui.INDEX_SIZE),
            ):
                gl.glBindBuffer(target, name)
                gl.glBufferData(target, data.size() * size, c_void_p(data.data_address()), gl.GL_STREAM_DRAW)
            for command in part.cmd_buffer:
                left, top, right, bottom = command.clip_rect
                if right <= left or bottom <= top:
                    continue
                gl.glBindTexture(gl.GL_TEXTURE_2D, command.tex_ref.get_tex_id())
                gl.glScissor(int(left), int(height - bottom), int(right - left), int(bottom - top))
                offset = c_void_p(command.idx_offset * imgui.INDEX_SIZE)
                gl.glDrawElements(gl.GL_TRIANGLES, command.elem_count, index, offset)
        gl.glDisable(gl.GL_SCISSOR_TEST)
        gl.glBindVertexArray(0)
        gl.glBindTexture(gl.GL_TEXTURE_2D, 0)
        self._program.stop()

    def _renew(self, texture: ImTextureData) -> None:
        """Create, update or free a texture as Dear ImGui requests; glyphs are added as they are needed."""
        from pyglet import gl

        wants = self._imgui.ImTextureStatus
        if texture.status == wants.want_destroy:
            gl.glDeleteTextures(1, gl.GLuint(texture.tex_id))
            texture.set_tex_id(0)
            texture.status = wants.destroyed
            return
        name = gl.GLuint(texture.tex_id)
        if texture.status == wants.want_create:
            gl.glGenTextures(1, name)
            texture.set_tex_id(name.value)
        gl.glBindTexture(gl.GL_TEXTURE_2D, name)
        for key, value in (
            (gl.GL_TEXTURE_MIN_FILTER, gl.GL_LINEAR), (gl.GL_TEXTURE_MAG_FILTER, gl.GL_LINEAR),
            (gl.GL_TEXTURE_WRAP_S, gl.GL_CLAMP_TO_EDGE), (gl.GL_TEXTURE_WRAP_T, gl.GL_CLAMP_TO_EDGE),
        ):  # fmt: skip
            gl.glTexParameteri(gl.GL_TEXTURE_2D, key, value)
        pixels = np.ascontiguousarray(np.asarray(texture.get_pixels_array(), dtype=np.uint8))
        gl.glPixelStorei(gl.GL_UNPACK_ALIGNMENT, 1)
        gl.glPixelStorei(gl.GL_UNPACK_ROW_LENGTH, 0)
        gl.glTexImage2D(
            gl.GL_TEXTURE_2D, 0, gl.GL_RGBA, texture.width, texture.height, 0, gl.GL_RGBA, gl.GL_UNSIGNED_BYTE,
            c_void_p(pixels.ctypes.data),
        )  # fmt: skip
        gl.glPixelStorei(gl.GL_UNPACK_ALIGNMENT, 4)
        texture.status = wants.ok

    def delete(self) -> None:
        """Free everything."""
        from pyglet import gl

        for texture in self._imgui.get_platform_io().textures:
            if texture.tex_id:
                texture.status = self._imgui.ImTextureStatus.want_destroy
                self._renew(texture)
        gl.glDeleteBuffers(2, (gl.GLuint * 2)(self._vertices, self._elements))
        gl.glDeleteVertexArrays(1, self._array)
