"""The panel's triangles in pixels, off-screen."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.command.dear_imgui import REMEDY
from softlab.app.output.offscreen import opengl_available, read_pixels
from softlab.app.render.opengl import open_window
from softlab.app.window.panel.style import DARK, LIGHT, PanelStyle, Theme


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=["light", "dark"])
def test_a_frame_covers_its_column_and_nothing_else(theme: Theme) -> None:
    pytest.importorskip("imgui_bundle", reason=f"the panel needs Dear ImGui: {REMEDY}")
    works, told = opengl_available()
    if not works:
        pytest.skip(told)
    from pyglet import gl

    from softlab.app.window.panel.context import Context
    from softlab.app.window.panel.drawing import Drawing

    window = open_window(True, 320, 200)
    context = Context(PanelStyle(theme, 1.0))
    imgui = context.imgui

    def column() -> None:
        imgui.set_next_window_pos((160, 0))
        imgui.set_next_window_size((160, 200))
        imgui.begin("column", None, int(imgui.WindowFlags_.no_decoration))
        imgui.text("softlab")
        imgui.end()

    drawing = Drawing(imgui)
    try:
        for _ in range(3):  # glyphs are made when they are asked for
            gl.glClearColor(0.0, 1.0, 0.0, 1.0)
            gl.glClear(gl.GL_COLOR_BUFFER_BIT)
            context.frame(320, 200, column, seconds=1 / 60)
            drawing.draw(320, 200)
        picture = read_pixels(320, 200)[:, :, :3].astype(int)
    finally:
        drawing.delete()
        context.close()
        window.close()
    assert (picture[:, :160] == (0, 255, 0)).all(), "the scene's"
    ground, ink = (np.round(255 * np.array(colour)) for colour in (theme.ground, theme.ink))
    assert np.abs(picture[100:, 162:] - ground).max() <= 1
    text = picture[:40, 162:]
    assert np.abs(text - ink).max(axis=2).min() < 60, "letters"
    assert 20 < (np.abs(text - ground).max(axis=2) > 40).sum() < 2000
