"""The panel's sliders: every field of the scene, what is live before what opens the world anew."""

from __future__ import annotations

from itertools import groupby

from app.window.panel.parameters import Parameter, parameters_of, value_of
from app.window.panel.sections.said import Said

ANEW = (
    "A change of these opens the world anew when you let go, with the state carried over where the masses are the same."
)
DEAR = 2000  # fields: of more, as a scene of hundreds of parts has, the first are shown


def parameters(said: Said) -> None:
    """A row a field; the tables that it is in are headings."""
    demo, rows = said.demo, said.rows
    scene, told = demo.world.scene, demo.scenes[demo.current]
    found = parameters_of(scene, told, demo.world.options.live)
    gravity = [one for one in found if one.path.startswith("gravity.")]
    if not gravity:
        rows.heading("gravity")
        if rows.check("Gravity on", demo.gravity, "G"):
            demo.toggle_gravity()
    _rows(said, [one for one in found if one.live][:DEAR])
    fixed = [one for one in found if not one.live][:DEAR]
    if not fixed:
        return
    rows.gap(2)
    if said.rows.imgui.tree_node(f"Compiled in ({len(fixed)})"):
        rows.note(ANEW)
        _rows(said, fixed)
        said.rows.imgui.tree_pop()
    rows._place("compiled in")


def _rows(said: Said, fields: list[Parameter]) -> None:
    demo, rows = said.demo, said.rows
    scene, told = demo.world.scene, demo.scenes[demo.current]
    for part, of_part in groupby(fields, key=lambda one: one.part):
        rows.heading(part)
        for one in of_part:
            new = rows.parameter(one, value_of(scene, one.path), value_of(told, one.path))
            if new is not None:
                demo.set_field(one.path, new)
                if one.path == "method.dt" and not demo.frozen:
                    demo.say(f"dt {demo.world.scene.method.dt:.4g} s, {demo.limit_text()}")
        if part == "method":
            rows.value("limit of dt", demo.limit_text(), "warning" if demo.over_limit else "faint")
