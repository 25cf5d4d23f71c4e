"""The panel's choice of scenes: another one, or several side by side."""

from __future__ import annotations

from softlab.app.window.panel.scene_list import Entry, scene_entries
from softlab.app.window.panel.sections.said import Said
from softlab.app.window.panes import MAX_WORLDS, view_kind
from softlab.model.base.errors import SoftlabError
from softlab.model.scene.scene import Scene, load_scene

ALL, DUPLICATE, ONLY = "all scenes", "Duplicate to compare", "Keep only this scene"


def _loaded(said: Said, name: str) -> Scene | None:
    """A scene by its name or file; an error is shown as a message."""
    try:
        return load_scene(name)
    except SoftlabError as error:
        said.demo.say(str(error))
        return None


def _beside(said: Said) -> list[Entry]:
    """The scenes that can be shown beside the current ones."""
    kind = view_kind(said.demo.world.scene)
    return [entry for entry in scene_entries() if entry.kind == kind]


def scene(said: Said) -> None:
    """Another scene, a scene beside the current ones, the current scene twice."""
    demo, rows, state = said.demo, said.rows, said.state
    now = demo.world.scene
    chosen = rows.scene_choice(
        "Scene", now.title, scene_entries, "Open another scene: yours in this folder, or one of the lab's."
    )
    if chosen is not None and (found := _loaded(said, chosen)) is not None:
        state.pending.clear()
        if demo.show([found]):
            demo.say(f"opened {chosen}")
    if len(demo.worlds) < MAX_WORLDS:
        tip = f"Show another scene side by side, from its start. The list holds those that show {view_kind(now)}."
        beside = rows.scene_choice("Add", "Add a scene beside it", lambda: _beside(said), tip)
        if beside is not None and (found := _loaded(said, beside)) is not None:
            demo.show([*(world.scene for world in demo.worlds), found])
    several = len(demo.worlds) > 1
    rows.gap(1)
    pressed = rows.buttons((DUPLICATE,) + ((ONLY,) if several else ()))
    rows.tip(
        "" if several else "Show the scene twice, side by side, as it is now. Later changes apply to the second copy."
    )
    if pressed == DUPLICATE:
        demo.compare()
    elif pressed:
        demo.keep_current()
    if len(demo.worlds) > 1:
        target = demo.titles[demo.current] if demo.alone else ALL
        chosen = rows.choice(
            "Changes apply to", target, (ALL, *demo.titles), "The scene that sliders and keys change. Key Tab."
        )
        if chosen is not None:
            demo.choose(None if chosen == ALL else demo.titles.index(chosen))
