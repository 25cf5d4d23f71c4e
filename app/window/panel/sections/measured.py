"""Measurements of the run: frame times, energy, momentum, error, counts."""

from __future__ import annotations

from softlab.app.presentation import presentation_of
from softlab.app.window.demo_report import counts_of, rates_text, strain_text
from softlab.app.window.panel import graphs
from softlab.app.window.panel.sections.frame import PanelFrame
from softlab.model.base.errors import SoftlabError

BUTTON = "Measure the error now"
SIGNS = {"total": "accent", "kinetic": "second"}


def measured(frame: PanelFrame) -> None:
    """Lay out graphs, then numbers."""
    demo, rows, style, history = frame.demo, frame.rows, frame.style, frame.state.history
    imgui = rows.imgui
    rows.heading("milliseconds per frame")
    graphs.frame_times(imgui, style, frame.viewer.overlay.times)
    time = history.column("time")
    shown = [(name, SIGNS[name], history.column("energy" if name == "total" else name)) for name in SIGNS]
    rows.gap(1)
    graphs.curves(imgui, style, "energy", "J", time, shown)
    rows.gap(1)
    graphs.curves(imgui, style, "momentum", "kg·m/s", time, [("", "accent", history.column("momentum"))])
    rows.gap(2)
    rows.value("Speed", rates_text(demo, frame.viewer.frame_seconds).replace("   ", ", "))
    rows.value(presentation_of(demo.world.scene).quantity, strain_text(demo))
    counts = frame.state.cached("counts", (demo.world, demo.world.body), lambda: counts_of(demo.world))
    for name, number in counts.items():
        rows.value(name, f"{number:,}".replace(",", " "))
    _error(frame)


def _error(frame: PanelFrame) -> None:
    """Lay out the distance to a converged reference, computed when the button is pressed; it takes up to seconds."""
    rows, state = frame.rows, frame.state
    rows.gap(2)
    if rows.button(BUTTON, -1.0):
        state.error = error_text(frame)
    rows.tip("Distance to a converged reference at this time. Takes up to a few seconds.")
    if state.error:
        rows.note(state.error)


def error_text(frame: PanelFrame) -> str:
    """Return the error in words, or the reason why there is none."""
    demo, judge = frame.demo, frame.viewer.judge
    when = f"at {demo.world.time:.3f} s"
    if judge is None:
        return "no error available: this window was opened without a reference; use softlab demo"
    if demo.disturbed:
        return f"no error available: {demo.disturbed}, which no reference includes; press Restart"
    if demo.frozen:
        return "no error available: the scene diverged; press Restart"
    try:
        error, why = judge(demo.world.scene, demo.world.state(), None)
    except SoftlabError as failed:
        return str(failed)
    return f"error {error:.2e} spacings {when}" if error is not None else f"no error available: {why}"
