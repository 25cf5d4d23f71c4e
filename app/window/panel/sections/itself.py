"""How the panel itself looks."""

from __future__ import annotations

from softlab.app.window.panel.look import DARK, LIGHT, SIZES
from softlab.app.window.panel.sections.said import Said


def itself(said: Said) -> None:
    """Light or dark, and its size."""
    rows, look = said.rows, said.look
    pressed = rows.buttons(("Light", "Dark"), "Dark" if look.dark else "Light")
    if pressed:
        look.theme = DARK if pressed == "Dark" else LIGHT
    sizes = [f"{size:g}x" for size in SIZES]
    pressed = rows.buttons(sizes, f"{look.unit:g}x")
    if pressed:
        look.unit = SIZES[sizes.index(pressed)]
    rows.note("Key A closes the panel. Ctrl+click a slider to type a number.")
