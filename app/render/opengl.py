"""Access to OpenGL by pyglet, loaded late and once, for a window or for pictures without one.

At its first use pyglet selects a display or EGL for the life of the process. Its errors become BackendUnavailable with
a remedy.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import TYPE_CHECKING

from softlab.model.base.errors import BackendUnavailable

if TYPE_CHECKING:
    from pyglet.graphics.shader import ShaderProgram
    from pyglet.window import BaseWindow

BARS = 80  # pixels of a screen that the window's title and the desktop's bar take
DEBIAN_OFFSCREEN = "apt-get install libegl1 libgl1 libgl1-mesa-dri libfontconfig1 libfreetype6 fonts-dejavu-core"
OFFSCREEN_REMEDY = (
    f"on Debian or Ubuntu: {DEBIAN_OFFSCREEN}; elsewhere install EGL with an OpenGL 3.3 driver (Mesa or the graphics "
    "card's), fontconfig, freetype and one font"
)
WINDOW_REMEDY = (
    "start it in a desktop session (or with DISPLAY set) and with an OpenGL 3.3 driver; "
    "for a picture without a window: softlab run SCENE --render frame.png"
)


def load_pyglet(headless: bool) -> ModuleType:
    """Return the pyglet module, set up for a window (`headless` False) or for EGL. Raises BackendUnavailable if this
    process already uses the other, or if pyglet cannot be loaded."""
    remedy = OFFSCREEN_REMEDY if headless else WINDOW_REMEDY
    try:
        import pyglet
    except Exception as error:  # whatever keeps it from loading, the user needs the remedy
        raise BackendUnavailable(f"pyglet cannot be loaded ({_reason(error)})", remedy) from None
    if "pyglet.window" in sys.modules:
        if bool(pyglet.options["headless"]) != headless:
            have, want = (
                ("pictures without a window", "a window") if not headless else ("a window", "off-screen drawing")
            )
            raise BackendUnavailable(
                f"this process already draws {have}, and pyglet cannot change to {want} within a process",
                "start a fresh Python process for it",
            )
    else:
        pyglet.options["headless"] = headless
        pyglet.options["debug_gl"] = False  # a glGetError after every call costs more than the drawing
        pyglet.options["audio"] = ("silent",)
    if not headless and sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        raise BackendUnavailable("no display to open a window on (DISPLAY is not set)", WINDOW_REMEDY)
    try:
        import pyglet.gl
        import pyglet.window
    except Exception as error:
        _forget_window()
        raise BackendUnavailable(f"OpenGL cannot be loaded ({_reason(error)})", remedy) from None
    return pyglet


def open_window(headless: bool, width: int, height: int, caption: str | None = None) -> BaseWindow:
    """Return a pyglet window (off-screen: of exactly `width` x `height` pixels; else no larger than the screen) with an
    OpenGL 3.3 context, made current.

    Raises BackendUnavailable.
    """
    pyglet = load_pyglet(headless)
    remedy = OFFSCREEN_REMEDY if headless else WINDOW_REMEDY
    try:
        # EGL sorts what it has by what was asked for, and unasked may give 5 bits a colour; a display has its own depth.
        depth = {f"{colour}_size": 8 for colour in ("red", "green", "blue")} if headless else {}
        config = pyglet.gl.Config(double_buffer=True, major_version=3, minor_version=3, **depth)
        if not headless:
            screen = pyglet.display.get_display().get_default_screen()
            width, height = min(width, screen.width), min(height, screen.height - BARS)
        window = pyglet.window.Window(width, height, caption=caption, resizable=not headless, vsync=True, config=config)
        window.switch_to()
    except Exception as error:
        what = "off-screen OpenGL does not work here" if headless else "no window can be opened"
        raise BackendUnavailable(f"{what} ({_reason(error)})", remedy) from None
    return window


def renderer_name() -> str:
    """Return the name of the renderer, from the driver. Needs a current context."""
    import pyglet.gl

    context = pyglet.gl.current_context
    return str(context.get_info().get_renderer()) if context else "none"


def shader_program(vertex: str, fragment: str, geometry: str | None = None) -> ShaderProgram:
    """Compile and link a program from these sources. Needs a current context. Raises BackendUnavailable where the
    driver refuses it."""
    from pyglet.graphics.shader import Shader, ShaderException, ShaderProgram

    try:
        shaders = [Shader(vertex, "vertex"), Shader(fragment, "fragment")]
        if geometry is not None:
            shaders.insert(1, Shader(geometry, "geometry"))
        return ShaderProgram(*shaders)
    except ShaderException as error:
        raise BackendUnavailable(
            f"the OpenGL driver refuses the shaders ({' '.join(str(error).split())[:200]})",
            "install a driver with OpenGL 3.3 or newer (Debian: apt-get install libgl1-mesa-dri)",
        ) from None


@contextmanager
def drawing_text() -> Iterator[None]:
    """Turn the errors of pyglet without a font, fontconfig or freetype into BackendUnavailable."""
    from pyglet.font.base import FontException

    try:
        yield
    except (ImportError, FontException) as error:
        raise BackendUnavailable(f"text cannot be drawn ({_reason(error)})", OFFSCREEN_REMEDY) from None


def _reason(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _forget_window() -> None:
    """Drop a half-imported pyglet.window, so that the next try fails with the same reason."""
    for name in [name for name in sys.modules if name == "pyglet.window" or name.startswith("pyglet.window.")]:
        del sys.modules[name]
