"""The panel in the demo's window: opened and closed by **A**, beside the scene, which gets the rest of the window.
Closed, it costs one comparison per frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softlab.app.command.dear_imgui import REMEDY, panel_available
from softlab.app.window.panel.context import Context
from softlab.app.window.panel.layout import Layout
from softlab.app.window.panel.state import PanelState
from softlab.app.window.panel.style import SIZES, PanelStyle
from softlab.app.window.window_protocol import WindowProtocol

if TYPE_CHECKING:
    from softlab.app.window.panel.drawing import Drawing

MOST = 0.65  # of the window's width


class Panel:
    """The panel. `open`: it is shown; `width`: the pixels of the window's right side that it takes. Mouse places are
    frame-buffer pixels from the lower left corner; the methods for mouse and keys return True if the panel takes the
    event."""

    def __init__(self, viewer: WindowProtocol):
        self.viewer, self.demo = viewer, viewer.demo
        self.open = False
        self.style = PanelStyle()
        self.state = PanelState()
        self._context: Context | None = None
        self._layout: Layout | None = None
        self._drawing: Drawing | None = None
        self._names: dict[int, str] = {}  # of keys
        self._pressed_buttons: set[int] = set()  # buttons that went down over it

    @property
    def width(self) -> int:
        """Width [pixels], 0 while it is closed; most of a narrow window."""
        return min(self.style.width, round(MOST * self.viewer.width)) if self.open else 0

    def toggle(self) -> None:
        """Show or hide the panel, or show a message with the remedy if its package is missing (A)."""
        works, reason = panel_available()
        if not works:
            self.demo.say(f"{reason}; {REMEDY}")
            return
        if self._context is None:
            self._make()
        self.open = not self.open
        self.demo.wants_momentum = self.open
        self._pressed_buttons.clear()

    def _make(self) -> None:
        """Create fonts, buffers and shaders at the first opening."""
        from softlab.app.window.panel.drawing import Drawing

        window, key = self.viewer.window, self.viewer.pyglet.window.key
        scale = float(getattr(window, "scale", 1.0) or 1.0)
        self.style.unit = max(size for size in SIZES if size <= max(scale, 1.0))
        self._context = Context(self.style)
        self._drawing = Drawing(self._context.imgui)
        self._layout = Layout(self._context.imgui, self.viewer, self.style, self.state)
        self._names = {symbol: name for name, symbol in vars(key).items() if name.isupper() and isinstance(symbol, int)}
        buttons = self.viewer.pyglet.window.mouse
        self._buttons = {buttons.LEFT: 0, buttons.RIGHT: 1, buttons.MIDDLE: 2}

    def lay_out(self) -> None:
        """Lay out a frame and carry out what was pressed in it."""
        if self._context is not None and self._layout is not None:
            self.style.apply(self._context.imgui)
            self._context.frame(self.viewer.width, self.viewer.height, self._layout.draw)

    def draw(self) -> None:
        """Draw the last frame of it over the window."""
        if self._context is not None and self._drawing is not None and self._context.frames:
            self._drawing.draw(self.viewer.width, self.viewer.height)

    def widget_places(self) -> dict[str, list[int]] | None:
        """Return the places of the panel's widgets for another program: (left, top, right, bottom) [pixels]; None while
        it is closed."""
        if not self.open:
            return None
        return {name: [round(edge) for edge in place] for name, place in self.state.places.items()}

    def close(self) -> None:
        """Free everything."""
        if self._context is not None:
            self._context.make_current()
            if self._drawing is not None:
                self._drawing.delete()
            self._context.close()
            self._context = None
        self.open = False

    # ------------------------------------------------------------------ what is its

    @property
    def takes_keys(self) -> bool:
        """True if text is being typed into it, or it is dragged."""
        return self.open and self._context is not None and self._context.takes_keys

    def _over(self, x: float) -> bool:
        """Return True if a place across the window belongs to the panel, or to a popup that it opened over the scene."""
        return x >= self.viewer.shown_width or (self._context is not None and self._context.takes_mouse)

    def moved(self, x: float, y: float) -> bool:
        """Handle the pointer at (x, y), with or without a button down."""
        if not self.open or self._context is None:
            return False
        self._context.mouse_at(x, self.viewer.height - y)
        return bool(self._pressed_buttons) or self._over(x)

    def pressed(self, x: float, y: float, button: int) -> bool:
        """Handle a button that went down."""
        if not self.open or self._context is None or button not in self._buttons:
            return False
        self._context.mouse_at(x, self.viewer.height - y)
        if not self._over(x):
            return False
        self._pressed_buttons.add(button)
        self._context.mouse_button(self._buttons[button], True)
        return True

    def released(self, button: int) -> bool:
        """Handle a button that went up."""
        if button not in self._pressed_buttons or self._context is None:
            return False
        self._pressed_buttons.discard(button)
        self._context.mouse_button(self._buttons[button], False)
        return True

    def scrolled(self, x: float, y: float, across: float, up: float) -> bool:
        """Handle a turn of the wheel."""
        if not self.open or self._context is None or not self._over(x):
            return False
        self._context.mouse_at(x, self.viewer.height - y)
        self._context.wheel(across, up)
        return True

    def key(self, symbol: int, down: bool) -> bool:
        """Handle a key that went down or up."""
        if not self.open or self._context is None:
            return False
        name = self._names.get(symbol, "")
        self.state.cancels |= down and name == "ESCAPE" and self._context.lists_words
        self._context.key(name, down)
        return down and self._context.takes_keys

    def text(self, text: str) -> bool:
        """Handle typed characters."""
        if not self.takes_keys or self._context is None:
            return False
        self._context.text(text)
        return True
