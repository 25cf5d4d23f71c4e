"""What the panel tells of the run: frame times, energy, momentum, error, counts."""

from __future__ import annotations

from app.window.demo_report import counts_of, strain_text
from app.window.panel import graphs
from app.window.panel.sections.said import Said
from model.core.errors import SoftlabError

SIGNS = {"total": "accent", "kinetic": "second"}


def measured(said: Said) -> None:
    """Graphs, then numbers."""
    demo, rows, look, history = said.demo, said.rows, said.look, said.state.history
    imgui = rows.imgui
    rows.heading("milliseconds a frame")
    graphs.frame_times(imgui, look, said.viewer.overlay.times)
    time = history.column("time")
    shown = [(name, SIGNS[name], history.column("energy" if name == "total" else name)) for name in SIGNS]
    rows.gap(1)
    graphs.curves(imgui, look, "energy", "J", time, shown)
    rows.gap(1)
    graphs.curves(imgui, look, "momentum", "kg·m/s", time, [("", "accent", history.column("momentum"))])
    rows.gap(2)
    speed = 1 / max(said.viewer.frame_seconds, 1e-6)
    going = not (demo.paused or demo.frozen)
    rows.value("Frames", f"{speed:.0f} a second, {speed * demo.steps_of(demo.world) * going:.0f} steps a second")
    rows.value("Fluid" if demo.world.scene.fluids else "Strain", strain_text(demo))
    counts = said.state.kept("counts", (demo.world, demo.world.body), lambda: counts_of(demo.world))
    for name, number in counts.items():
        rows.value(name, f"{number:,}".replace(",", " "))
    _error(said)


def _error(said: Said) -> None:
    """The distance to a converged reference, when it is asked for: it takes up to seconds."""
    rows, state = said.rows, said.state
    rows.gap(2)
    if rows.button("Error now", -1.0):
        state.error = error_text(said)
    rows.tip("the distance to a converged reference at this time; up to a few seconds")
    if state.error:
        rows.note(state.error)


def error_text(said: Said) -> str:
    """In words, or why there is none."""
    demo, judge = said.demo, said.viewer.judge
    when = f"at {demo.world.time:.3f} s"
    if judge is None:
        return "error not known: nobody judges here; softlab demo does"
    if demo.disturbed:
        return f"error not known: {demo.disturbed}, and no reference knows that; Restart"
    if demo.frozen:
        return "error not known: diverged"
    try:
        error, why = judge(demo.world.scene, demo.world.state(), None)
    except SoftlabError as failed:
        return str(failed)
    return f"error {error:.2e} of the spacing {when}" if error is not None else f"error not known: {why}"
