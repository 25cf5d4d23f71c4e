"""Keys and mouse of the demo's window, and the action of each. The descriptions are in app/window/keys.py."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from softlab.app.window.mouse import Mouse
from softlab.app.window.window_protocol import WindowProtocol


class Controls:
    """Turns the events of a Viewer's window into actions of its Demo and its Camera; `mouse` does so for the mouse."""

    def __init__(self, viewer: WindowProtocol):
        self.viewer, self.demo, self.window = viewer, viewer.demo, viewer.window
        self.mouse = Mouse(viewer)
        self.key = viewer.pyglet.window.key
        key, demo, view_options = self.key, self.demo, viewer.view_options
        self._key_actions: dict[int, Callable[[], object]] = {
            key.TAB: demo.next_world,
            key.G: demo.toggle_gravity,
            key.SPACE: demo.toggle_pause,
            key.R: demo.restart,
            key.B: demo.switch_backend,
            key.T: demo.cycle_threads,
            key.A: viewer.panel.toggle,
            key.S: viewer.shots.ask,
            key.H: viewer.overlay.toggle_keys,
            key.M: viewer.overlay.toggle_graph,
            key.N: viewer.overlay.toggle_numbers,
            key.F: viewer.frame_everything,
            key.L: view_options.toggle_lines,
            key.V: view_options.next_detail,
            key.W: view_options.toggle_foam,
            key.P: partial(view_options.toggle, "particles"),
            key.K: partial(view_options.toggle, "skin"),
            key.C: partial(view_options.toggle, "clusters"),
            key.I: partial(view_options.toggle, "links"),
            key.O: view_options.next_colouring,
            key.D: self._drop_body,
            key.X: demo.remove_body,
            key.DELETE: demo.remove_body,
            key.ENTER: demo.press_key,
            key.NUM_ENTER: demo.press_key,
            key.ESCAPE: viewer.close,
        }
        # By the character and not by the key, since on many keyboards these need Alt or Shift with another key.
        self._text_actions: dict[str, Callable[[], None]] = {
            "[": lambda: demo.change_dt(-1),
            "]": lambda: demo.change_dt(1),
            "{": lambda: demo.change_stiffness(-1),
            "}": lambda: demo.change_stiffness(1),
            "(": lambda: demo.change_material("poisson_ratio", -1),
            ")": lambda: demo.change_material("poisson_ratio", 1),
            "<": lambda: demo.change_material("damping", -1),
            ">": lambda: demo.change_material("damping", 1),
            "-": lambda: demo.change_steps(-1),
            "+": lambda: demo.change_steps(1),
            ".": demo.one_step,
        }
        self._motions = {
            key.MOTION_LEFT: (-1, 0),
            key.MOTION_RIGHT: (1, 0),
            key.MOTION_UP: (0, 1),
            key.MOTION_DOWN: (0, -1),
        }
        self._while_compiling = (key.ESCAPE, key.A, key.H, key.N, key.V)  # ask nothing of a world
        self._pointer: tuple[float, float] | None = None  # window coordinates, while it is over the window
        self._corner = (0, 0)  # pixels, of the pane in which a button went down last
        self._enter_keys = (key.ENTER, key.NUM_ENTER)
        self.window.push_handlers(
            on_key_press=self._key_down,
            on_key_release=self._key_up,
            on_text=self._text,
            on_text_motion=self._motion,
            on_mouse_motion=self._mouse_moved,
            on_mouse_leave=self._mouse_left,
            on_mouse_press=self._mouse_down,
            on_mouse_drag=self._mouse_drag,
            on_mouse_release=self._mouse_up,
            on_mouse_scroll=self._scroll,
            on_close=viewer.close,
        )

    # each is asked of the panel first: what is over it, or held or typed in it, is not the scene's

    def _key_down(self, symbol: int, modifiers: int) -> bool:
        if self.viewer.panel.key(symbol, True):
            return True
        action = self._key_actions.get(symbol)
        if self.demo.compiling is not None and symbol not in self._while_compiling:
            return True
        key = self.key
        if action is not None and not modifiers & (key.MOD_CTRL | key.MOD_ALT | key.MOD_COMMAND):
            action()
        return True  # pyglet's own handler would close the window on Escape in its own way

    def _key_up(self, symbol: int, modifiers: int) -> None:
        self.viewer.panel.key(symbol, False)
        if symbol in self._enter_keys and self.mouse.pointer is None:
            self.demo.release()

    def _text(self, text: str) -> None:
        action = None if self.viewer.panel.text(text) else self._text_actions.get(text)
        if action is not None and self.demo.compiling is None:
            action()

    def _motion(self, motion: int) -> None:
        if motion in self._motions and not self.viewer.panel.takes_keys and self.demo.compiling is None:
            step = self._motions[motion]
            self.demo.move_selection(*step, self.viewer.camera.direction(*step))

    def _drop_body(self) -> None:
        """Drop a body at the pointer, or at the middle of the view if the pointer is outside (D)."""
        viewer = self.viewer
        pane = viewer.panes[self.demo.current]
        place = pane.width / 2, pane.height / 2
        if self._pointer is not None and self.mouse.pointer is None:
            x, y = self._pixels(*self._pointer)
            pane = viewer.panes[viewer.world_at(x, y)]
            place = x - pane.left, y - pane.bottom
        self.demo.drop_body(viewer.drop_place(*place) if viewer.space else ())

    def _mouse_moved(self, x: float, y: float, dx: float, dy: float) -> None:
        taken = self.viewer.panel.moved(*self._pixels(x, y))
        self._pointer = None if taken else (x, y)

    def _mouse_left(self, x: float, y: float) -> None:
        self._pointer = None

    def _pixels(self, x: float, y: float) -> tuple[float, float]:
        """Mouse coordinates in frame-buffer pixels (they differ on some high-resolution displays)."""
        ratio = self.viewer.width / max(self.window.width, 1)
        return x * ratio, y * ratio

    def _in_pane(self, x: float, y: float) -> tuple[float, float]:
        """Return frame-buffer pixels from the lower left corner of the pane in which a button went down."""
        across, up = self._pixels(x, y)
        return across - self._corner[0], up - self._corner[1]

    def _enter(self, x: float, y: float) -> int:
        """Return the number of the world under the pointer; pane coordinates refer to it from now on."""
        number = self.viewer.world_at(*self._pixels(x, y))
        pane = self.viewer.panes[number]
        self._corner = pane.left, pane.bottom
        return number

    def _mouse_down(self, x: int, y: int, button: int, modifiers: int) -> None:
        if self.viewer.panel.pressed(*self._pixels(x, y), button):
            return
        if self.mouse.pointer is None:  # a second button changes nothing of what is held
            number = self._enter(x, y)
            if button == self.mouse.button.LEFT and self.demo.compiling is None:
                self.demo.turn_to(number)
        self.mouse.press(*self._in_pane(x, y), button)

    def _mouse_drag(self, x: int, y: int, dx: int, dy: int, buttons: int, modifiers: int) -> None:
        if self.viewer.panel.moved(*self._pixels(x, y)):
            return
        self.mouse.drag(*self._in_pane(x, y), *self._pixels(dx, dy))

    def _mouse_up(self, x: int, y: int, button: int, modifiers: int) -> None:
        if not self.viewer.panel.released(button):
            self.mouse.release(button)

    def _scroll(self, x: int, y: int, scroll_x: float, scroll_y: float) -> None:
        if self.viewer.panel.scrolled(*self._pixels(x, y), scroll_x, scroll_y):
            return
        if self.mouse.pointer is None:
            self._enter(x, y)
        self.mouse.scroll(*self._in_pane(x, y), scroll_y)
