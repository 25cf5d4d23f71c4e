"""The panel's choice of scenes: another one, or two side by side."""

from __future__ import annotations

from functools import cache

from app.window.panel.sections.said import Said
from model.core.errors import SoftlabError
from model.scene.reader import catalogue
from model.scene.scene import Scene, load_scene

EVERY = "every world"


@cache
def _names() -> tuple[str, ...]:
    return tuple(sorted(catalogue()))


def _loaded(said: Said, name: str) -> Scene | None:
    """A scene of the catalogue; what is wrong with it is said."""
    try:
        return load_scene(name)
    except SoftlabError as error:
        said.demo.say(str(error))
        return None


def scene(said: Said) -> None:
    """Another scene, another beside this one, this one twice."""
    demo, rows, state = said.demo, said.rows, said.state
    chosen = rows.choice("Scene", demo.world.scene.name, _names(), "of the catalogue; it opens at its start")
    if chosen is not None and (found := _loaded(said, chosen)) is not None:
        state.pending.clear()
        if demo.show([found]):
            demo.say(f"opened {chosen}")
    beside = rows.choice(
        "Beside it", "...", _names(), "another scene side by side with this one, both from their start"
    )
    if beside is not None and (found := _loaded(said, beside)) is not None:
        demo.show([demo.world.scene, found])
    several = len(demo.worlds) > 1
    rows.gap(1)
    pressed = rows.buttons(("Compare: twice",) + (("This one alone",) if several else ()))
    rows.tip("the scene as it is now, side by side with itself; what you change then is changed in the second")
    if pressed == "Compare: twice":
        demo.compare()
    elif pressed:
        demo.keep_current()
    if len(demo.worlds) > 1:
        now = demo.titles[demo.current] if demo.alone else EVERY
        chosen = rows.choice("Change", now, (EVERY, *demo.titles), "Tab: what is changed below, and by keys")
        if chosen is not None:
            demo.choose(None if chosen == EVERY else demo.titles.index(chosen))
