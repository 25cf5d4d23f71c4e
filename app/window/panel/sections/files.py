"""Pictures, clips, the scene and its state as files."""

from __future__ import annotations

from pathlib import Path

from softlab.app.window import snapshot
from softlab.app.window.panel.sections.frame import PanelFrame


def files(frame: PanelFrame) -> None:
    """Lay out the buttons that save and load."""
    viewer, rows, state, demo = frame.viewer, frame.rows, frame.state, frame.demo
    clip = "Stop recording" if viewer.shots.recording else "Record a clip"
    pressed = rows.buttons(("Picture", clip), clip if viewer.shots.recording else "")
    if pressed == "Picture":
        viewer.shots.ask()
    elif pressed:
        viewer.shots.toggle_clip()
    rows.heading("scene with the current settings")
    state.scene_file = rows.line("Scene file", state.scene_file, "name.toml (empty: automatic)")
    if rows.button("Save the scene", -1.0):
        snapshot.save_scene(demo, state.scene_file)
    rows.heading("state: positions, velocities, time")
    state.state_file = rows.line("State file", state.state_file, "name.npz (empty: automatic)")
    pressed = rows.buttons(("Save the state", "Load the state"))
    if pressed == "Save the state":
        state.state_file = snapshot.save_state(demo, state.state_file) or state.state_file
    elif pressed:
        snapshot.load_state(demo, state.state_file)
    chosen = rows.choice(
        "Existing files", "choose ...", tuple(sorted(path.name for path in Path.cwd().glob("*.npz")))[:200]
    )
    if chosen is not None:
        state.state_file = chosen
