"""Render targets of 32-bit floats for a fluid's surface, and full-screen drawing."""

from __future__ import annotations

from softlab.model.base.errors import BackendUnavailable

DEPTH, OTHER_DEPTH, THICKNESS, NORMALS, OUTLINE, BEHIND, BEHIND_DEPTH = range(7)
FRAMES = BEHIND_DEPTH  # each picture but this one has a frame buffer


class FluidPictures:
    """`resize`, `begin(which)` or `onto(which)` to draw into one, `bind(name=which)` to read from, `screen()` to draw
    over all its pixels; `delete()` frees them. Needs a current OpenGL 3.3 context. Raises BackendUnavailable if the
    driver does not support float targets.
    """

    def __init__(self) -> None:
        from pyglet import gl

        self.size = (0, 0)
        self._frames = (gl.GLuint * FRAMES)()
        gl.glGenFramebuffers(FRAMES, self._frames)
        self._pictures = (gl.GLuint * (FRAMES + 1))()
        gl.glGenTextures(FRAMES + 1, self._pictures)
        self._store = gl.GLuint()  # depth of the first frame buffer
        gl.glGenRenderbuffers(1, self._store)
        self._empty = gl.GLuint()
        gl.glGenVertexArrays(1, self._empty)

    def resize(self, width: int, height: int) -> None:
        """Resize the pictures; their contents are lost."""
        from pyglet import gl

        if self.size == (width, height):
            return
        self.size = (width, height)
        red, two = (gl.GL_R32F, gl.GL_RED), (gl.GL_RG32F, gl.GL_RG)
        four, eight = (gl.GL_RGBA32F, gl.GL_RGBA), (gl.GL_RGBA8, gl.GL_RGBA)
        for picture, (inside, outside) in zip(self._pictures, (red, red, four, four, two, eight), strict=False):
            self._picture(picture, inside, outside, gl.GL_FLOAT)
        self._picture(self._pictures[BEHIND_DEPTH], gl.GL_DEPTH_COMPONENT24, gl.GL_DEPTH_COMPONENT, gl.GL_UNSIGNED_INT)
        gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, self._store)
        gl.glRenderbufferStorage(gl.GL_RENDERBUFFER, gl.GL_DEPTH_COMPONENT24, width, height)
        for frame, picture in zip(self._frames, self._pictures, strict=False):
            gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, frame)
            gl.glFramebufferTexture2D(gl.GL_FRAMEBUFFER, gl.GL_COLOR_ATTACHMENT0, gl.GL_TEXTURE_2D, picture, 0)
        gl.glFramebufferTexture2D(
            gl.GL_FRAMEBUFFER, gl.GL_DEPTH_ATTACHMENT, gl.GL_TEXTURE_2D, self._pictures[BEHIND_DEPTH], 0
        )
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._frames[0])
        gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, gl.GL_DEPTH_ATTACHMENT, gl.GL_RENDERBUFFER, self._store)
        for frame in self._frames:
            gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, frame)
            status = gl.glCheckFramebufferStatus(gl.GL_FRAMEBUFFER)
            if status != gl.GL_FRAMEBUFFER_COMPLETE:
                raise BackendUnavailable(
                    f"the OpenGL driver refuses pictures of 32-bit floats (status {status:#x})",
                    "install a driver with OpenGL 3.3 or newer, or show the fluid as particles",
                )

    def _picture(self, picture: int, inside: int, outside: int, kind: int) -> None:
        from pyglet import gl

        gl.glBindTexture(gl.GL_TEXTURE_2D, picture)
        gl.glTexImage2D(gl.GL_TEXTURE_2D, 0, inside, *self.size, 0, outside, kind, None)
        for name in (gl.GL_TEXTURE_MIN_FILTER, gl.GL_TEXTURE_MAG_FILTER):
            gl.glTexParameteri(gl.GL_TEXTURE_2D, name, gl.GL_NEAREST if outside != gl.GL_RGBA else gl.GL_LINEAR)
        for name in (gl.GL_TEXTURE_WRAP_S, gl.GL_TEXTURE_WRAP_T):
            gl.glTexParameteri(gl.GL_TEXTURE_2D, name, gl.GL_CLAMP_TO_EDGE)
        gl.glBindTexture(gl.GL_TEXTURE_2D, 0)

    def onto(self, which: int, size: tuple[int, int] | None = None) -> None:
        """Draw into a picture, or its first `size` pixels, from now on."""
        from pyglet import gl

        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._frames[which])
        gl.glViewport(0, 0, *(size or self.size))

    def begin(self, which: int) -> None:
        """Draw into a picture from now on, on nothing."""
        from pyglet import gl

        self.onto(which)
        gl.glClearColor(0.0, 0.0, 0.0, 0.0)
        gl.glClear(gl.GL_COLOR_BUFFER_BIT | (gl.GL_DEPTH_BUFFER_BIT if which == DEPTH else 0))

    def bind(self, **pictures: int) -> None:
        """Bind pictures to the samplers of the program in use, by name."""
        from pyglet import gl

        for unit, (_, which) in enumerate(pictures.items()):
            gl.glActiveTexture(gl.GL_TEXTURE0 + unit)
            gl.glBindTexture(gl.GL_TEXTURE_2D, self._pictures[which])
        gl.glActiveTexture(gl.GL_TEXTURE0)

    def screen(self) -> None:
        """Run the program in use for every pixel."""
        from pyglet import gl

        gl.glBindVertexArray(self._empty)
        gl.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        gl.glBindVertexArray(0)

    def copy_from(self, frame: int | None) -> None:
        """Copy picture and depth of a frame buffer of the same size into BEHIND and BEHIND_DEPTH, which become the
        target of drawing. None: nothing, infinitely far away. Writing of depth must be enabled."""
        from pyglet import gl

        width, height = self.size
        both = gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._frames[BEHIND])
        if frame is None:
            gl.glClear(both)
            return
        gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, frame)
        gl.glBlitFramebuffer(0, 0, width, height, 0, 0, width, height, both, gl.GL_NEAREST)

    def delete(self) -> None:
        """Free them."""
        from pyglet import gl

        gl.glDeleteFramebuffers(FRAMES, self._frames)
        gl.glDeleteTextures(FRAMES + 1, self._pictures)
        gl.glDeleteRenderbuffers(1, self._store)
        gl.glDeleteVertexArrays(1, self._empty)
