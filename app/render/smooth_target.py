"""A multisampled frame buffer with depth that is copied into the window when the picture is complete.

It is separate from the window's, so that 2-D drawing is unchanged and off-screen pictures get the same edges. It may be
smaller than its destination.
"""

from __future__ import annotations

from softlab.app.render.detail import Detail
from softlab.model.base.errors import BackendUnavailable


class SmoothTarget:
    """`begin(width, height)` redirects all drawing to it; `finish()` copies it to the previous target, in its viewport;
    `delete()` frees it.

    Needs a current OpenGL 3.3 context, the same in every call. Raises BackendUnavailable if the driver refuses it.
    """

    def __init__(self, detail: Detail) -> None:
        from pyglet import gl

        most = gl.GLint()
        gl.glGetIntegerv(gl.GL_MAX_SAMPLES, most)
        self.samples = min(detail.samples, max(int(most.value), 0))
        self._size = (0, 0)
        self._before, self._box = 0, (gl.GLint * 4)()
        self._frames = (gl.GLuint * 2)()  # with samples, and resolved: the window's own format may be another
        self._stores = (gl.GLuint * 3)()  # colour and depth with samples, resolved colour
        gl.glGenFramebuffers(2, self._frames)
        gl.glGenRenderbuffers(3, self._stores)

    @property
    def frame(self) -> int:
        """The frame buffer of the target."""
        return int(self._frames[0])

    def begin(self, width: int, height: int) -> None:
        """Redirect drawing to this target, `width` x `height` pixels; nothing is cleared."""
        from pyglet import gl

        bound = gl.GLint()
        gl.glGetIntegerv(gl.GL_DRAW_FRAMEBUFFER_BINDING, bound)
        self._before = int(bound.value)
        gl.glGetIntegerv(gl.GL_VIEWPORT, self._box)
        if self._size != (width, height):
            self._allocate(width, height)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._frames[0])
        gl.glViewport(0, 0, width, height)

    def _allocate(self, width: int, height: int) -> None:
        from pyglet import gl

        colour, depth = gl.GL_COLOR_ATTACHMENT0, gl.GL_DEPTH_ATTACHMENT
        for frame, store, place, form, samples in (
            (0, 0, colour, gl.GL_RGBA8, self.samples),
            (0, 1, depth, gl.GL_DEPTH_COMPONENT24, self.samples),
            (1, 2, colour, gl.GL_RGBA8, 0),
        ):
            gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._frames[frame])
            gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, self._stores[store])
            gl.glRenderbufferStorageMultisample(gl.GL_RENDERBUFFER, samples, form, width, height)
            gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, place, gl.GL_RENDERBUFFER, self._stores[store])
        for frame in (1, 0):
            gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._frames[frame])
            status = gl.glCheckFramebufferStatus(gl.GL_FRAMEBUFFER)
            if status != gl.GL_FRAMEBUFFER_COMPLETE:
                gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._before)
                raise BackendUnavailable(
                    f"the OpenGL driver refuses a picture of {width} x {height} pixels with depth (status {status:#x})",
                    "draw a smaller picture, or install a driver with OpenGL 3.3 or newer",
                )
        self._size = (width, height)

    def finish(self) -> None:
        """Copy the picture to the target that was bound before `begin`, and bind that again."""
        from pyglet import gl

        width, height = self._size
        left, bottom, wide, high = self._box
        frame = self._frames[0]
        if self.samples:  # the window's format may be another, into which samples cannot be resolved
            self._copy(frame, (width, height), self._frames[1], (0, 0, width, height))
            frame = self._frames[1]
        self._copy(frame, (width, height), self._before, (left, bottom, left + wide, bottom + high))
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._before)
        gl.glViewport(*self._box)

    @staticmethod
    def _copy(source: int, size: tuple[int, int], goal: int, box: tuple[int, int, int, int]) -> None:
        from pyglet import gl

        gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, source)
        gl.glBindFramebuffer(gl.GL_DRAW_FRAMEBUFFER, goal)
        gl.glBlitFramebuffer(0, 0, *size, *box, gl.GL_COLOR_BUFFER_BIT, gl.GL_NEAREST)

    def delete(self) -> None:
        """Free it."""
        from pyglet import gl

        gl.glDeleteFramebuffers(2, self._frames)
        gl.glDeleteRenderbuffers(3, self._stores)
