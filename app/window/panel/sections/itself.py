"""Settings of the panel itself."""

from __future__ import annotations

from softlab.app.window.panel.sections.frame import PanelFrame
from softlab.app.window.panel.style import DARK, LIGHT, SIZES


def itself(frame: PanelFrame) -> None:
    """Lay out the panel's own settings: theme and size."""
    rows, style = frame.rows, frame.style
    pressed = rows.buttons(("Light", "Dark"), "Dark" if style.dark else "Light")
    if pressed:
        style.theme = DARK if pressed == "Dark" else LIGHT
    sizes = [f"{size:g}x" for size in SIZES]
    pressed = rows.buttons(sizes, f"{style.unit:g}x")
    if pressed:
        style.unit = SIZES[sizes.index(pressed)]
    rows.note("Key A closes the panel. Ctrl+click a slider to type a number.")
