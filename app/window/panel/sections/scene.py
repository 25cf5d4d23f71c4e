"""The panel's choice of scenes: one, or several side by side."""

from __future__ import annotations

from softlab.app.window.panel.scene_list import Entry, scene_entries
from softlab.app.window.panel.sections.frame import PanelFrame
from softlab.app.window.panes import MAX_WORLDS, view_kind
from softlab.model.base.errors import SoftlabError
from softlab.model.scene.scene import Scene, load_scene

ALL, DUPLICATE, ONLY = "all scenes", "Duplicate to compare", "Keep only this scene"


def _loaded(frame: PanelFrame, name: str) -> Scene | None:
    """Return a scene by its name or file, or None with the error as a message."""
    try:
        return load_scene(name)
    except SoftlabError as error:
        frame.demo.say(str(error))
        return None


def _beside(frame: PanelFrame) -> list[Entry]:
    """Return the scenes that can be shown beside the current ones."""
    kind = view_kind(frame.demo.world.scene)
    return [entry for entry in scene_entries() if entry.kind == kind]


def scene(frame: PanelFrame) -> None:
    """Lay out the choice of another scene, of a scene beside the current ones, and of a second copy of the current
    scene."""
    demo, rows, state = frame.demo, frame.rows, frame.state
    now = demo.world.scene
    chosen = rows.scene_choice(
        "Scene", now.title, scene_entries, "Open another scene: yours in this folder, or one of the lab's."
    )
    if chosen is not None and (loaded := _loaded(frame, chosen)) is not None:
        state.pending.clear()
        if demo.show([loaded]):
            demo.say(f"opened {chosen}")
    if len(demo.worlds) < MAX_WORLDS:
        tip = f"Show another scene side by side, from its start. The list holds those that show {view_kind(now)}."
        beside = rows.scene_choice("Add", "Add a scene beside it", lambda: _beside(frame), tip)
        if beside is not None and (loaded := _loaded(frame, beside)) is not None:
            demo.show([*(world.scene for world in demo.worlds), loaded])
    several = len(demo.worlds) > 1
    rows.gap(1)
    pressed = rows.buttons((DUPLICATE,) + ((ONLY,) if several else ()))
    rows.tip(
        "" if several else "Show the scene twice, side by side, as it is now. Later changes apply to the second copy."
    )
    if pressed == DUPLICATE:
        demo.compare()
    elif pressed:
        demo.show_current_only()
    if len(demo.worlds) > 1:
        target = demo.titles[demo.current] if demo.alone else ALL
        chosen = rows.choice(
            "Changes apply to", target, (ALL, *demo.titles), "The scene that sliders and keys change. Key Tab."
        )
        if chosen is not None:
            demo.choose(None if chosen == ALL else demo.titles.index(chosen))
