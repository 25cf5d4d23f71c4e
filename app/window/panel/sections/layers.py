"""What is drawn of a scene: the same as the keys L, P, K, C, I, O, W and V do."""

from __future__ import annotations

from softlab.app.render.detail import DETAILS
from softlab.app.window.panel.sections.said import Said

INSIDE = (("particles", "Particles"), ("skin", "Skins"), ("clusters", "Clusters"), ("links", "Links"))


def _fluid(said: Said) -> None:
    """A surface, in space, or particles; foam."""
    viewer, rows, looks = said.viewer, said.rows, said.viewer.looks
    first = viewer.views[0]
    if viewer.space:
        pressed = rows.buttons(("Surface", "Particles"), "Particles" if first.lines else "Surface")
        if pressed and (pressed == "Particles") != first.lines:
            looks.toggle_lines()
    else:
        rows.note("A fluid in a plane is always drawn as particles.")
    if rows.check(
        "Spray, foam, bubbles",
        first.foam,
        "Points generated where air is trapped. Drawn only; they do not change the motion. Key W.",
    ):
        looks.toggle_foam()


def layers(said: Said) -> None:
    """Boxes for layers, and colours."""
    viewer, rows, looks = said.viewer, said.rows, said.viewer.looks
    first, scene = viewer.views[0], said.demo.world.scene
    if first.subject == "fluid":
        _fluid(said)
    elif not viewer.space:
        rows.note("A scene in a plane is always drawn as springs coloured by strain.")
    elif viewer.bodies:
        for name, word in INSIDE:
            if rows.check(word, getattr(first, name)):
                looks.toggle(name)
    elif first.subject == "tetrahedra":
        names = ("Skins", "Tetrahedra", "Edges")
        now = names[2] if first.lines else names[0] if first.skin else names[1]
        pressed = rows.buttons(names, now)
        if pressed and pressed != now:
            if (pressed == names[2]) != first.lines:
                looks.toggle_lines()
            if pressed != names[2] and (pressed == names[0]) != first.skin:
                looks.toggle("skin")
    elif rows.check("Springs", first.lines, "Show springs instead of the surface. Key L."):
        looks.toggle_lines()
    if viewer.space and scene.colliders and rows.check("Colliders", first.colliders):
        looks.toggle_colliders()
    if first.colourings:
        rows.heading("colour by")
        pressed = rows.buttons(first.colourings, first.colouring, "colour ")
        if pressed:
            looks.colour_by(pressed)
    if viewer.space:
        rows.heading("picture quality")
        pressed = rows.buttons([detail.name for detail in DETAILS], first.detail.name, "picture ")
        if pressed:
            looks.show_in(next(detail for detail in DETAILS if detail.name == pressed))
    rows.heading("overlays")
    overlay = viewer.overlay
    for word, on, toggle in (
        ("Numbers", overlay.show_numbers, overlay.toggle_numbers), ("Frame times", overlay.show_graph, overlay.toggle_graph),
        ("Keys", overlay.show_keys, overlay.toggle_keys),
    ):  # fmt: skip
        if rows.check(word, on):
            toggle()
