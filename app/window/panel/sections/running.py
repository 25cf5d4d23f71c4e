"""The head of the panel: scene, time, play and pause, speed."""

from __future__ import annotations

from softlab.app.window.panel.sections.frame import PanelFrame
from softlab.app.window.worlds import STEPS_PER_FRAME


def head(frame: PanelFrame) -> None:
    """Lay out the head, which stays visible when the sections are scrolled."""
    demo, rows, imgui = frame.demo, frame.rows, frame.rows.imgui
    world = demo.world
    rows.bold(demo.titles[demo.current], 17.0)
    state = "diverged" if demo.frozen else "paused" if demo.paused else "running"
    rows.note(f"time {world.time:.3f} s   step {world.step}   {state}", "warning" if demo.frozen else "faint")
    pressed = rows.buttons(("Play" if demo.paused else "Pause", "Step", "Restart"), "" if demo.paused else "Pause")
    if pressed in ("Play", "Pause"):
        demo.toggle_pause()
    elif pressed == "Step":
        demo.one_step()
    elif pressed == "Restart":
        frame.state.pending.clear()
        demo.restart()
    place = STEPS_PER_FRAME.index(demo.steps_per_frame)
    rows.name("Speed", "Steps per frame of the window. Keys - and +.")
    imgui.set_next_item_width(-1)
    seconds_per_frame = demo.steps_per_frame * max(w.scene.method.dt for w in demo.worlds)
    each = (
        f"{demo.steps_per_frame} step{'s' * (demo.steps_per_frame != 1)} per frame ({seconds_per_frame * 1e3:.3g} ms)"
    )
    last = len(STEPS_PER_FRAME) - 1
    changed, chosen = rows.filled(lambda: imgui.slider_int("##speed", place, 0, last, each), place / last)
    rows.record_place("speed")
    if changed and 0 <= chosen < len(STEPS_PER_FRAME):
        demo.set_steps(STEPS_PER_FRAME[chosen])
    rows.gap(1)
