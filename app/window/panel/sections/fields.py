"""The panel's sliders: every field of the scene, live fields before those that need a recompile."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby

from softlab.app.window.materials import FACTORS, bodies_of
from softlab.app.window.panel.parameters import Parameter, parameters_of
from softlab.app.window.panel.sections.frame import PanelFrame

ANEW = "Changing one of these reopens the scene when you release the slider. The state is kept if the masses stay the same."
DEAR = 2000  # fields: of more, as a scene of hundreds of parts has, the first are shown


def parameters(frame: PanelFrame) -> None:
    """Lay out a row per field; the names of their tables are headings."""
    demo, rows = frame.demo, frame.rows
    scene, initial = demo.world.scene, demo.scenes[demo.current]
    live = demo.world.options.live
    fields = frame.state.cached("fields", (scene, initial, live), lambda: parameters_of(scene, initial, live))
    gravity = [one for one in fields if one.path.startswith("gravity.")]
    if not gravity:
        rows.heading("gravity")
        if rows.check("Gravity on", demo.gravity, "Key G."):
            demo.toggle_gravity()
    _rows(frame, [one for one in fields if one.live][:DEAR])
    if bodies_of(scene):
        _material(frame, fields)
    fixed = [one for one in fields if not one.live][:DEAR]
    if not fixed:
        return
    rows.gap(2)
    once = int(rows.imgui.Cond_.once)
    rows.imgui.set_next_item_open(frame.state.every, once)
    if rows.imgui.tree_node(f"Needs a recompile ({len(fixed)})###fixed"):
        rows.note(ANEW)
        for part, of_part in groupby(fixed, key=lambda one: one.part):
            rows.imgui.set_next_item_open(frame.state.every, once)
            if rows.imgui.tree_node(part):
                _rows(frame, list(of_part), headed=False)
                rows.imgui.tree_pop()
            rows.record_place(f"table {part}")
        rows.imgui.tree_pop()
    rows.record_place("needs a recompile")


def _material(frame: PanelFrame, fields: list[Parameter]) -> None:
    """Lay out the material of all tetrahedral bodies, in three rows."""
    demo, rows, scene = frame.demo, frame.rows, frame.demo.world.scene
    bodies = list(bodies_of(scene))
    initial = demo.scenes[demo.current]
    rows.heading(bodies[0] if len(bodies) == 1 else f"material of {len(bodies)} bodies (changed together)")
    for field in FACTORS:
        one = next((one for one in fields if one.path == f"{bodies[0]}.{field}"), None)
        if one is None:
            continue
        row = replace(one, path=f"{one.path} ")  # a row of its own, beside that of the table
        new = rows.parameter(row, scene.value(one.path), initial.value(one.path))
        if isinstance(new, int | float):
            demo.change_material_to(field, new)


def _rows(frame: PanelFrame, fields: list[Parameter], headed: bool = True) -> None:
    demo, rows = frame.demo, frame.rows
    scene, initial = demo.world.scene, demo.scenes[demo.current]
    for part, of_part in groupby(fields, key=lambda one: one.part):
        if headed:
            rows.heading(part)
        for one in of_part:
            new = rows.parameter(one, scene.value(one.path), initial.value(one.path))
            if new is not None and demo.set_field(one.path, new):
                if one.path == "method.dt":
                    demo.say(f"dt {demo.world.scene.method.dt:.4g} s, {demo.limit_text()}")
        if part == "method" and headed:
            rows.value("stability", demo.limit_text(), "warning" if demo.over_limit else "faint")
