"""Layers of the drawing: the same as the keys L, P, K, C, I, O, W and V."""

from __future__ import annotations

from softlab.app.render.detail import DETAILS
from softlab.app.window.panel.sections.frame import PanelFrame

INSIDE = (("particles", "Particles"), ("skin", "Skins"), ("clusters", "Clusters"), ("links", "Links"))


def _fluid(frame: PanelFrame) -> None:
    """Lay out surface or particles, and foam."""
    rows, view_options = frame.rows, frame.viewer.view_options
    first = frame.viewer.views[0]
    pressed = rows.buttons(("Surface", "Particles"), "Particles" if first.lines else "Surface")
    if pressed and (pressed == "Particles") != first.lines:
        view_options.toggle_lines()
    if rows.check(
        "Spray, foam, bubbles",
        first.foam,
        "Points generated where air is trapped. Drawn only; they do not change the motion. Key W.",
    ):
        view_options.toggle_foam()


def layers(frame: PanelFrame) -> None:
    """Lay out the check boxes of layers, and the choice of colours."""
    viewer, rows, view_options = frame.viewer, frame.rows, frame.viewer.view_options
    first, scene = viewer.views[0], frame.demo.world.scene
    if first.subject == "fluid":
        _fluid(frame)
    elif not viewer.space:
        rows.note("A scene in a plane is always drawn as springs coloured by strain.")
    elif viewer.bodies:
        for name, word in INSIDE:
            if rows.check(word, getattr(first, name)):
                view_options.toggle(name)
    elif first.subject == "tetrahedra":
        names = ("Skins", "Tetrahedra", "Edges")
        now = names[2] if first.lines else names[0] if first.skin else names[1]
        pressed = rows.buttons(names, now)
        if pressed and pressed != now:
            if (pressed == names[2]) != first.lines:
                view_options.toggle_lines()
            if pressed != names[2] and (pressed == names[0]) != first.skin:
                view_options.toggle("skin")
    elif rows.check("Springs", first.lines, "Show springs instead of the surface. Key L."):
        view_options.toggle_lines()
    if viewer.space and scene.colliders and rows.check("Colliders", first.colliders):
        view_options.toggle_colliders()
    if first.colourings:
        rows.heading("colour by")
        pressed = rows.buttons(first.colourings, first.colouring, "colour ")
        if pressed:
            view_options.colour_by(pressed)
    if viewer.space:
        rows.heading("picture quality")
        pressed = rows.buttons([detail.name for detail in DETAILS], first.detail.name, "picture ")
        if pressed:
            view_options.show_in(next(detail for detail in DETAILS if detail.name == pressed))
    rows.heading("overlays")
    overlay = viewer.overlay
    for word, on, toggle in (
        ("Numbers", overlay.show_numbers, overlay.toggle_numbers), ("Frame times", overlay.show_graph, overlay.toggle_graph),
        ("Keys", overlay.show_keys, overlay.toggle_keys),
    ):  # fmt: skip
        if rows.check(word, on):
            toggle()
