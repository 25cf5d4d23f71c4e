"""Dear ImGui's side of the panel: its context, its mouse and key events, and a frame of it. No window and no OpenGL: a
test pushes events and checks their effects."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from types import ModuleType

from softlab.app.command.dear_imgui import load_imgui
from softlab.app.window.panel.style import PanelStyle

KEYS = {  # pyglet's names of keys -> Dear ImGui's: those that texts and sliders know
    "TAB": "tab", "BACKSPACE": "backspace", "RETURN": "enter", "ENTER": "enter", "NUM_ENTER": "keypad_enter",
    "ESCAPE": "escape", "DELETE": "delete", "SPACE": "space", "LEFT": "left_arrow", "RIGHT": "right_arrow",
    "UP": "up_arrow", "DOWN": "down_arrow", "HOME": "home", "END": "end", "PAGEUP": "page_up", "PAGEDOWN": "page_down",
    "LCTRL": "left_ctrl", "RCTRL": "right_ctrl", "LSHIFT": "left_shift", "RSHIFT": "right_shift", "LALT": "left_alt",
    "RALT": "right_alt", "LCOMMAND": "left_super", "RCOMMAND": "right_super",
    "A": "a", "C": "c", "V": "v", "X": "x", "Z": "z",
}  # fmt: skip
MODIFIERS = {"ctrl": "mod_ctrl", "shift": "mod_shift", "alt": "mod_alt", "super": "mod_super"}
LONGEST_FRAME = 0.1  # s that it is told to have passed, at most: after a compilation nothing is to jump


class Context:
    """A context of Dear ImGui with the lab's `style`; `imgui`: the module; `frames` so far. Raises BackendUnavailable if it
    is missing."""

    def __init__(self, style: PanelStyle | None = None):
        self.imgui: ModuleType = load_imgui()
        self._context = self.imgui.create_context()
        self.make_current()  # it is not, where there is one already
        self.style = style or PanelStyle()
        self.style.load_fonts(self.imgui)
        self.style.apply(self.imgui)
        io = self.io = self.imgui.get_io()
        io.set_ini_filename("")  # it writes nothing
        io.set_log_filename("")
        io.backend_flags |= self.imgui.BackendFlags_.renderer_has_textures
        self._last = perf_counter()
        self.frames = 0

    def frame(self, width: int, height: int, draw: Callable[[], None], seconds: float | None = None) -> None:
        """Lay out the frame that `draw` describes over a window of `width` x `height` pixels. `seconds`: time since the
        last frame; measured by default."""
        self.make_current()
        now = perf_counter()
        passed = now - self._last if seconds is None else seconds
        self._last = now
        self.io.delta_time = min(max(passed, 1e-4), LONGEST_FRAME)  # by itself: pyglet's clock is the window's
        self.io.display_size = self.imgui.ImVec2(width, height)
        self.imgui.new_frame()
        draw()
        self.imgui.render()
        self.frames += 1

    def make_current(self) -> None:
        """Make this the active one of several contexts."""
        self.imgui.set_current_context(self._context)

    # ------------------------------------------------------------------ events, in pixels from the upper left corner

    def mouse_at(self, x: float, y: float) -> None:
        """Send the position of the pointer."""
        self.io.add_mouse_pos_event(x, y)

    def mouse_button(self, number: int, down: bool) -> None:
        """Send a mouse button: left 0, right 1, middle 2."""
        self.io.add_mouse_button_event(number, down)

    def wheel(self, across: float, up: float) -> None:
        """Send notches of the wheel."""
        self.io.add_mouse_wheel_event(across, up)

    def key(self, name: str, down: bool) -> None:
        """Send a key by pyglet's name, if Dear ImGui knows it."""
        known = KEYS.get(name)
        if known is None:
            return
        self.io.add_key_event(getattr(self.imgui.Key, known), down)
        side, _, word = known.partition("_")
        if side in ("left", "right") and word in MODIFIERS:
            self.io.add_key_event(getattr(self.imgui.Key, MODIFIERS[word]), down)

    def text(self, characters: str) -> None:
        """Send typed characters."""
        for character in characters:
            if character.isprintable():
                self.io.add_input_character(ord(character))

    @property
    def takes_mouse(self) -> bool:
        """True if the pointer is over a widget of the panel, or drags one."""
        return bool(self.io.want_capture_mouse)

    @property
    def takes_keys(self) -> bool:
        """True if something is being typed, dragged or chosen from a list."""
        return bool(self.io.want_text_input or self.io.want_capture_keyboard or self.lists_words)

    @property
    def lists_words(self) -> bool:
        """True if a list of words is open to be chosen from."""
        flag = self.imgui.PopupFlags_
        return bool(self.imgui.is_popup_open("", int(flag.any_popup_id | flag.any_popup_level)))

    def close(self) -> None:
        """Free it."""
        self.imgui.destroy_context(self._context)
