"""Keys and mouse of the demo's window: which of them asks for what."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import zip_longest

from app.window.mouse import Mouse
from app.window.shown import Shown

KEYS = (
    ("G", "gravity on, off"),
    ("[ ]", "time step / 1.25, x 1.25"),
    ("{ }", "stiffness / 1.25, x 1.25"),
    ("- +", "fewer, more steps a frame"),
    ("space", "pause, go on"),
    ("R", "restart as the scene says"),
    ("B", "CPU or GPU, state kept"),
    ("T", "threads 1x, 2x, 4x the cores"),
    ("mouse", "drag a mass: pull it"),
    ("arrows", "select a mass"),
    ("Enter", "push it (down, or last arrow)"),
    ("wheel", "zoom at the pointer"),
    ("right", "drag: move the view"),
    ("F", "frame everything"),
    ("M", "milliseconds of frames: graph"),
    ("N", "numbers at the top"),
    ("A", "adjust everything: panel"),
    (".", "one step, then a pause"),
    ("S", "save a picture (PNG)"),
    ("Escape", "close"),
)
DETAIL_KEY = ("V", "fine, plain, quick picture")
SPACE_KEYS = (
    *KEYS[:8],
    ("L", "surface, springs"),
    DETAIL_KEY,
    *KEYS[8:11],
    ("left", "drag beside it: turn (middle)"),
    *KEYS[11:],
)
BODY_KEYS = (  # without springs there is no stiffness to change
    *KEYS[:2],
    *KEYS[3:8],
    ("P K C I", "particles, skin, clusters, links"),
    ("L", "particles or skin"),
    ("O", "colour by body, group, cluster"),
    DETAIL_KEY,
    ("D X", "drop a body, take one out"),
    ("mouse", "drag a body: pull it"),
    ("arrows", "select a particle"),
    ("Enter", "push its body (down, or arrow)"),
    *SPACE_KEYS[13:],
)
TETRAHEDRA_KEYS = (
    *SPACE_KEYS[:2],
    ("{ }", "Young's modulus / 1.25, x 1.25"),
    ("( )", "Poisson's ratio down, up"),
    ("< >", "damping / 2, x 2"),
    *SPACE_KEYS[3:8],
    ("L", "edges of tetrahedra, or surface"),
    ("K", "skin, or the mesh's surface"),
    ("O", "colour by body, stress, strain"),
    *SPACE_KEYS[9:],
)
WORLD_KEYS = (
    *SPACE_KEYS[:2],
    *SPACE_KEYS[3:8],
    ("L", "skins, or particles and edges"),
    *SPACE_KEYS[9:],
)
FLUID_KEYS = (
    *KEYS[:2],
    *KEYS[3:8],
    ("L", "surface, particles"),
    ("O", "colour by fluid, speed, density"),
    ("W", "white water: spray, foam, bubbles"),
    DETAIL_KEY,
    ("mouse", "drag a particle: pull it"),
    ("arrows", "select a particle"),
    ("Enter", "push it (down, or last arrow)"),
    *SPACE_KEYS[13:],
)
WORLDS_KEY = ("Tab", "change one world alone, all")
TWO_COLUMNS_FROM = 760  # pixels of window width
HINT = (
    "H: keys    G: gravity    drag a mass to pull it    space: pause    [ ]: time step    R: restart    Escape: close"
)
SPACE_HINT = (
    "H: keys    L: surface, springs    drag beside the cloth: turn    drag a mass to pull it    F: frame    "
    "space: pause    R: restart    Escape: close"
)
BODY_HINT = (
    "H: keys    P: particles    K: skin    drag beside the bodies: turn    drag a body to pull it    F: frame    "
    "space: pause    R: restart    Escape: close"
)
TETRAHEDRA_HINT = (
    "H: keys    O: stress, strain    K: skin, mesh    drag beside the bodies: turn    drag a body to pull it    F: frame    "
    "space: pause    R: restart    Escape: close"
)


FLUID_HINT = (
    "H: keys    L: surface, particles    O: colours    drag beside the fluid: turn    F: frame    space: pause    "
    "R: restart    Escape: close"
)
WORLD_HINT = (
    "H: keys    L: skins, particles and edges    drag beside the bodies: turn    drag a particle to pull it    F: frame    "
    "space: pause    R: restart    Escape: close"
)
OWN = {  # of what a view shows (View.subject), or of sheets in space and in a plane: keys, and those needed first
    "bodies": (BODY_KEYS, BODY_HINT),
    "tetrahedra": (TETRAHEDRA_KEYS, TETRAHEDRA_HINT),
    "fluid": (FLUID_KEYS, FLUID_HINT),
    "world": (WORLD_KEYS, WORLD_HINT),
    "space": (SPACE_KEYS, SPACE_HINT),
    "plane": (KEYS, HINT),
}
IN_SPACE = (DETAIL_KEY, ("left", "drag beside it: turn (middle)"))  # keys that a plane has no use for


def _own(subject: str, space: bool) -> tuple[tuple[tuple[str, str], ...], str]:
    return OWN.get(subject) or OWN["space" if space else "plane"]


def hint(subject: str = "sheet", space: bool = False, several: bool = False) -> str:
    """The keys that a user needs first; as `keys_text`."""
    _, found = _own(subject, space)
    if several:  # the last keys give way to it: the legend is beside them
        return found.replace("H: keys", "H: keys    Tab: one world alone").replace(
            "    R: restart    Escape: close", ""
        )
    return found


def keys_text(width: int, subject: str = "sheet", space: bool = False, several: bool = False) -> str:
    """What the keys do, in lines that fit a window of `width` pixels. `subject`: of what is shown (View.subject); `space`: in
    three dimensions; `several`: worlds side by side."""
    own = tuple(key for key in _own(subject, space)[0] if space or key not in IN_SPACE)
    keys = (*((WORLDS_KEY,) if several else ()), *own)
    lines = [f"{key:8}{meaning:33}" for key, meaning in keys]
    if width >= TWO_COLUMNS_FROM:
        half = (len(lines) + 1) // 2
        lines = [left + right for left, right in zip_longest(lines[:half], lines[half:], fillvalue="")]
    return "\n".join(line.rstrip() for line in [*lines, "H       shows and hides these keys"])


class Controls:
    """Turns the events of a Viewer's window into actions of its Demo and its Camera; `mouse` does so for the mouse."""

    def __init__(self, viewer: Shown):
        self.viewer, self.demo, self.window = viewer, viewer.demo, viewer.window
        self.mouse = Mouse(viewer)
        self.key = viewer.pyglet.window.key
        key, demo, looks = self.key, self.demo, viewer.looks
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
            key.L: looks.toggle_lines,
            key.V: looks.next_detail,
            key.W: looks.toggle_foam,
            key.P: partial(looks.toggle, "particles"),
            key.K: partial(looks.toggle, "skin"),
            key.C: partial(looks.toggle, "clusters"),
            key.I: partial(looks.toggle, "links"),
            key.O: looks.next_colouring,
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
        if action is not None:
            action()

    def _motion(self, motion: int) -> None:
        if motion in self._motions and not self.viewer.panel.takes_keys:
            way = self._motions[motion]
            self.demo.move_selection(*way, self.viewer.camera.direction(*way))

    def _drop_body(self) -> None:
        """D: over the pointer, or, where it is elsewhere, over the middle of what is seen."""
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
        """In frame-buffer pixels from the lower left corner of the pane in which a button went down."""
        across, up = self._pixels(x, y)
        return across - self._corner[0], up - self._corner[1]

    def _enter(self, x: float, y: float) -> int:
        """The number of the world under the pointer, whose pane coordinates are of from now on."""
        number = self.viewer.world_at(*self._pixels(x, y))
        pane = self.viewer.panes[number]
        self._corner = pane.left, pane.bottom
        return number

    def _mouse_down(self, x: int, y: int, button: int, modifiers: int) -> None:
        if self.viewer.panel.pressed(*self._pixels(x, y), button):
            return
        if self.mouse.pointer is None:  # a second button changes nothing of what is held
            number = self._enter(x, y)
            if button == self.mouse.button.LEFT:
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
