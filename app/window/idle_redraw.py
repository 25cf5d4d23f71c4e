"""Skips the frames of an idle window, in which nothing moves and which had no input for a while."""

from __future__ import annotations

from softlab.app.window.overlay import MESSAGE_SECONDS
from softlab.app.window.window_protocol import WindowProtocol

SETTLE = (
    60  # frames that are drawn after a touch: for a camera on its way, a tip that appears, a number that is renewed
)
TOUCHES = (
    "on_resize", "on_expose", "on_activate", "on_show", "on_key_press", "on_key_release", "on_text", "on_text_motion",
    "on_mouse_press", "on_mouse_release", "on_mouse_drag", "on_mouse_scroll",
)  # fmt: skip


class IdleRedraw:
    """Decides before each frame of a viewer's window, by `wanted(now)`, whether it is drawn; `now` [s] of
    perf_counter."""

    def __init__(self, viewer: WindowProtocol):
        self.viewer, self.demo = viewer, viewer.demo
        self._left = SETTLE
        self._messages = self.demo.message_count
        self._message_ends: float | None = None  # s of perf_counter
        # on top of all other handlers, and passing all on
        viewer.window.push_handlers(on_mouse_motion=self._over_panel, **dict.fromkeys(TOUCHES, self.touch))

    def touch(self, *_: object) -> None:
        """Draw the next frames, because there was input."""
        self._left = SETTLE

    def _over_panel(self, *_: object) -> None:
        if self.viewer.panel.open:
            self.touch()

    def wanted(self, now: float) -> bool:
        """Return True if the next frame may differ from the last one."""
        demo, viewer = self.demo, self.viewer
        if demo.message_count != self._messages:
            self._messages, self._message_ends = demo.message_count, now + MESSAGE_SECONDS
            self.touch()
        elif self._message_ends is not None and now > self._message_ends:
            self._message_ends = None
            self.touch()
        moves = not (demo.paused or demo.frozen) or demo.picker.poke is not None or demo.compiling is not None
        if moves or viewer.shots.recording or viewer.panel.takes_keys:
            self.touch()
        self._left -= 1
        return self._left >= 0
