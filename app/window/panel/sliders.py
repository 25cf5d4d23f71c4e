"""Sliders of the panel, and the row of a field: its name, its slider, and a button that restores the value of the
scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from math import log
from typing import Any, TypeVar

from softlab.app.window.panel.parameters import Parameter
from softlab.app.window.panel.rows import Rows

T = TypeVar("T")

RESET, ROUND = 26.0, 5.0  # units: of the button at the right, and of corners
DIGITS = 6  # of a slider's value: it goes through 32-bit numbers
UNITS = {"m/s^2": "m/s²", "1/s^2": "1/s²", "kg/m^2": "kg/m²", "kg/m^3": "kg/m³", "N s/m": "N·s/m"}


def rounded(value: float) -> float:
    """Round to the number of digits that a slider shows."""
    return float(f"{value:.{DIGITS}g}")


def fraction_of(value: float, low: float, high: float, logarithmic: bool) -> float:
    """Return the position of a value along a slider, 0 to 1."""
    if not low < high or not low <= value <= high:
        return float(value > low)
    if logarithmic and low > 0:
        return log(value / low) / log(high / low)
    return (value - low) / (high - low)


class Sliders(Rows):
    """Rows with sliders. Their methods return a new value if it changed, else None."""

    def slider(
        self, name: str, value: float, low: float, high: float, unit: str = "", logarithmic: bool = False, tip: str = ""
    ) -> float | None:
        """Draw a slider of a number, as wide as the column."""
        self.name(name, tip)
        self.imgui.set_next_item_width(-1)
        changed, new = self._drag(name, value, low, high, unit, logarithmic)
        return rounded(new) if changed else None

    def _drag(
        self, name: str, value: float, low: float, high: float, unit: str, logarithmic: bool
    ) -> tuple[bool, float]:
        """Draw a slider as a field that is filled up to its value, with the number upon it."""
        imgui = self.imgui
        flags = imgui.SliderFlags_.no_round_to_format | (imgui.SliderFlags_.logarithmic if logarithmic else 0)
        text = f"%.4g{'' if unit == '°' else ' '}{UNITS.get(unit, unit)}".rstrip()
        changed, new = self.filled(
            lambda: imgui.slider_float(f"##{name}", float(value), low, high, text, int(flags)),
            fraction_of(value, low, high, logarithmic),
        )
        self.record_place(name)
        return bool(changed), float(new)

    def filled(self, slider: Callable[[], tuple[bool, T]], fraction: float) -> tuple[bool, T]:
        """Return the result of `slider`, drawn as a field filled by `fraction`, 0 to 1."""
        imgui, unit = self.imgui, self.style.unit
        lines = imgui.get_window_draw_list()
        lines.channels_split(2)
        lines.channels_set_current(1)
        hidden = ("frame_bg", "frame_bg_hovered", "frame_bg_active", "slider_grab", "slider_grab_active")
        for part in hidden:
            imgui.push_style_color(int(getattr(imgui.Col_, part)), 0)
        result = slider()
        imgui.pop_style_color(len(hidden))
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        busy = imgui.is_item_active() or imgui.is_item_hovered()
        lines.channels_set_current(0)
        lines.add_rect_filled(low, high, self.style.colour(imgui, "hovered" if busy else "raised"), ROUND * unit)
        edge = low.x + fraction * (high.x - low.x)
        lines.push_clip_rect(low, (edge, high.y), True)
        lines.add_rect_filled(low, high, self.style.colour(imgui, "accent", 0.34 if busy else 0.24), ROUND * unit)
        lines.pop_clip_rect()
        lines.push_clip_rect((low.x, high.y - 3 * unit), (edge, high.y), True)  # a strip that no number covers
        lines.add_rect_filled(low, high, self.style.colour(imgui, "accent"), ROUND * unit)
        lines.pop_clip_rect()
        lines.channels_merge()
        return result

    def parameter(self, one: Parameter, now: object, initial: object) -> object:
        """Draw the row of a field and return its new value, once it is to be applied to the scene: live fields at once,
        others on release. The button at the right restores the `initial` value of the scene."""
        imgui, state = self.imgui, self.state
        unit = f", {UNITS.get(one.unit, one.unit)}" if one.kind == "vector" and one.unit else ""
        self.name(one.label + unit, _tip(one))
        shown = state.pending.get(one.path, now)
        imgui.set_next_item_width(-(RESET + 8) * self.style.unit)
        new: object = None
        if one.kind == "truth":
            pressed, new = imgui.checkbox(f"##{one.path}", bool(shown))
            self.record_place(one.path)
            new = bool(new) if pressed else None
        elif one.kind == "word":
            new = self.list_of_words(one.path, str(shown), one.words)
        else:
            new = self._number(one, shown)
        if initial is not None and initial != now and self._reset(one.path):
            state.pending.pop(one.path, None)
            return initial
        return new

    def _number(self, one: Parameter, shown: Any) -> object:
        imgui = self.imgui
        if one.kind == "vector":
            return self._vector(one, shown)
        if one.kind == "whole":
            changed, number = self.filled(
                lambda: imgui.slider_int(f"##{one.path}", int(shown), int(one.low), int(one.high), "%d"),
                fraction_of(float(shown), one.low, one.high, False),
            )
            self.record_place(one.path)
            new: float = int(number)
        else:
            changed, number = self._drag(one.path, shown, one.low, one.high, one.unit, one.logarithmic)
            new = rounded(number)
        return self._to_apply(one, new if changed else None, imgui.is_item_deactivated())

    def _vector(self, one: Parameter, shown: Iterable[float]) -> object:
        """Draw three sliders in the place of one, along x, y and z; left of their middle is less than 0."""
        imgui, gap = self.imgui, 4 * self.style.unit
        width = (imgui.calc_item_width() - 2 * gap) / 3
        parts, changed, let_go = [float(part) for part in shown], False, False
        for axis, value in enumerate(parts):
            if axis:
                imgui.same_line(0.0, gap)
            imgui.set_next_item_width(width)
            label = f"##{one.path}.{'xyz'[axis]}"
            moved, number = self.filled(
                partial(imgui.slider_float, label, value, one.low, one.high, "%.3g"),
                fraction_of(value, one.low, one.high, False),
            )
            self.record_place(f"{one.path}.{'xyz'[axis]}")
            parts[axis] = rounded(number) if moved else value
            changed, let_go = changed or moved, let_go or imgui.is_item_deactivated()
        return self._to_apply(one, tuple(parts) if changed else None, let_go)

    def _to_apply(self, one: Parameter, new: object, let_go: bool) -> object:
        """Return the value to apply to the scene now: a `new` live value at once, others once the slider is `let_go`."""
        if one.live:
            return new
        if new is not None:
            self.state.pending[one.path] = new
        return self.state.pending.pop(one.path, None) if let_go else None

    def _reset(self, path: str) -> bool:
        """Draw the reset button at the right: an arrow back, drawn, since not every font has one."""
        imgui, unit = self.imgui, self.style.unit
        imgui.same_line()
        height = imgui.get_frame_height()
        pressed = imgui.invisible_button(f"reset {path}", imgui.ImVec2(RESET * unit, height))
        self.record_place(f"reset {path}")
        colour = self.style.colour(imgui, "accent" if imgui.is_item_hovered() else "faint")
        low = imgui.get_item_rect_min()
        x, y, r = low.x + RESET * unit / 2, low.y + height / 2, 5 * unit
        lines = imgui.get_window_draw_list()
        lines.path_arc_to((x, y), r, -2.2, 2.6, 16)
        lines.path_stroke(colour, 1.6 * unit)
        tip_x, tip_y = x - 0.59 * r, y - 0.81 * r
        a = 4.2 * unit
        corners = ((-a, 0.3 * a), (0.5 * a, -a), (0.6 * a, 0.7 * a))
        lines.add_triangle_filled(*((tip_x + right, tip_y + down) for right, down in corners), colour)
        self.tip("Reset to the value of the scene file")
        return bool(pressed)


def _tip(one: Parameter) -> str:
    lines = [f"{one.path}{f': {one.note}' if one.note else ''}"]
    if one.kind in ("number", "whole") and one.high > one.low:
        lines.append(
            f"Slider range {one.low:.4g} to {one.high:.4g} {UNITS.get(one.unit, one.unit)}".rstrip()
            + ". Ctrl+click to type a number."
        )
    if not one.live:
        lines.append(
            f"Releasing the slider reopens the scene ({one.why}). The state is kept if the masses stay the same."
        )
    return "\n".join(lines)
