"""What the panel is laid out of: a name at the left and something to change at the right, each a row; buttons; lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from app.window.panel.look import Look
from app.window.panel.parameters import Parameter
from app.window.panel.state import PanelState

NAME, RESET = 126.0, 26.0  # units: of the names' column, and of the button at the right
DIGITS = 6  # of a slider's value: it goes through 32-bit numbers
UNITS = {"m/s^2": "m/s²", "1/s^2": "1/s²", "kg/m^2": "kg/m²", "kg/m^3": "kg/m³", "N s/m": "N·s/m"}


def rounded(value: float) -> float:
    """As many digits as a slider has."""
    return float(f"{value:.{DIGITS}g}")


class Rows:
    """Rows of a panel in the frame that is being laid out. What changes gives its new value, else None."""

    def __init__(self, imgui: Any, look: Look, state: PanelState):
        self.imgui, self.look, self.state = imgui, look, state

    # ------------------------------------------------------------------ text

    def bold(self, text: str, size: float = 15.0) -> None:
        """A line in bold type of so many units."""
        self.imgui.push_font(self.look.bold, size)
        self.imgui.text_unformatted(text)
        self.imgui.pop_font()

    def note(self, text: str, colour: str = "faint", size: float = 13.0) -> None:
        """Wrapped lines that are read last."""
        imgui = self.imgui
        imgui.push_font(self.look.plain, size)
        imgui.push_style_color(int(imgui.Col_.text), self.look.colour(imgui, colour))
        imgui.push_text_wrap_pos(0.0)
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
        imgui.pop_style_color()
        imgui.pop_font()

    def heading(self, text: str) -> None:
        """Of a group of rows."""
        self.gap(3)
        self.imgui.push_font(self.look.bold, 13.0)
        self.imgui.push_style_color(int(self.imgui.Col_.text), self.look.colour(self.imgui, "faint"))
        self.imgui.text_unformatted(text)
        self.imgui.pop_style_color()
        self.imgui.pop_font()

    def gap(self, units: float) -> None:
        """Empty space."""
        self.imgui.dummy(self.imgui.ImVec2(1, units * self.look.unit))

    def value(self, name: str, text: str, colour: str = "ink") -> None:
        """A number that is told and cannot be changed."""
        self._name(name)
        imgui = self.imgui
        imgui.push_style_color(int(imgui.Col_.text), self.look.colour(imgui, colour))
        imgui.push_text_wrap_pos(0.0)
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
        imgui.pop_style_color()

    def tip(self, text: str) -> None:
        """What is told of the last thing, where the pointer rests on it."""
        imgui = self.imgui
        if text and imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.begin_tooltip()
            imgui.push_text_wrap_pos(300 * self.look.unit)
            imgui.text_unformatted(text)
            imgui.pop_text_wrap_pos()
            imgui.end_tooltip()

    def _name(self, name: str, tip: str = "") -> None:
        imgui = self.imgui
        imgui.align_text_to_frame_padding()
        imgui.text_unformatted(name)
        self.tip(tip)
        imgui.same_line(NAME * self.look.unit)

    def _place(self, name: str) -> None:
        """Keep where the last thing lies."""
        low, high = self.imgui.get_item_rect_min(), self.imgui.get_item_rect_max()
        self.state.places[name] = low.x, low.y, high.x, high.y

    # ------------------------------------------------------------------ what can be pressed

    def button(self, text: str, width: float = 0.0, on: bool = False, name: str = "") -> bool:
        """Whether it was pressed; `width` in pixels, `on`: it stands out."""
        imgui = self.imgui
        if on:
            for part in ("button", "button_hovered", "button_active"):
                imgui.push_style_color(int(getattr(imgui.Col_, part)), self.look.colour(imgui, "accent"))
            imgui.push_style_color(int(imgui.Col_.text), self.look.colour(imgui, "on_accent"))
        pressed = bool(imgui.button(f"{text}##{name or text}", imgui.ImVec2(width, 0)))
        if on:
            imgui.pop_style_color(4)
        self._place(name or text)
        return pressed

    def buttons(self, names: Sequence[str], on: str = "", prefix: str = "") -> str:
        """A row of buttons as wide as the column, of which one may stand out; the one that was pressed, or nothing."""
        imgui, found = self.imgui, ""
        gap = imgui.get_style().item_spacing.x
        width = (imgui.get_content_region_avail().x - gap * (len(names) - 1)) / len(names)
        for number, name in enumerate(names):
            if number:
                imgui.same_line()
            if self.button(name, width, name == on, f"{prefix}{name}"):
                found = name
        return found

    def check(self, name: str, on: bool, tip: str = "") -> bool:
        """Whether it was pressed."""
        pressed, _ = self.imgui.checkbox(name, on)
        self._place(name)
        self.tip(tip)
        return bool(pressed)

    def choice(self, name: str, now: str, words: Sequence[str], tip: str = "", height: int = 12) -> str | None:
        """One of some words."""
        imgui, chosen = self.imgui, None
        self._name(name, tip)
        imgui.set_next_item_width(-1)
        imgui.set_next_window_size_constraints((0, 0), (1e4, height * imgui.get_frame_height_with_spacing()))
        if imgui.begin_combo(f"##{name}", now):
            for word in words:
                pressed, _ = imgui.selectable(word, word == now)
                if pressed:
                    chosen = word
            imgui.end_combo()
        self._place(name)
        return chosen if chosen != now else None

    def line(self, name: str, text: str, hint: str) -> str:
        """A line to type in, as it is now."""
        self._name(name)
        self.imgui.set_next_item_width(-1)
        _, typed = self.imgui.input_text_with_hint(f"##{name}", hint, text)
        self._place(name)
        return str(typed)

    # ------------------------------------------------------------------ sliders

    def slider(
        self, name: str, value: float, low: float, high: float, unit: str = "", logarithmic: bool = False, tip: str = ""
    ) -> float | None:
        """A slider of a number alone, as wide as the column."""
        self._name(name, tip)
        self.imgui.set_next_item_width(-1)
        changed, found = self._drag(name, value, low, high, unit, logarithmic)
        return rounded(found) if changed else None

    def _drag(
        self, name: str, value: float, low: float, high: float, unit: str, logarithmic: bool
    ) -> tuple[bool, float]:
        imgui = self.imgui
        flags = imgui.SliderFlags_.no_round_to_format | (imgui.SliderFlags_.logarithmic if logarithmic else 0)
        format = f"%.4g {UNITS.get(unit, unit)}".rstrip()
        changed, found = imgui.slider_float(f"##{name}", float(value), low, high, format, int(flags))
        self._place(name)
        return bool(changed), float(found)

    def parameter(self, one: Parameter, now: Any, told: Any) -> Any:
        """A row for one field: its new value, once it is to be given to the scene. What is not live waits until it is let
        go. The button at the right takes back what the scene said."""
        imgui, state = self.imgui, self.state
        self._name(one.label, _tip(one))
        shown = state.pending.get(one.path, now)
        imgui.set_next_item_width(-(RESET + 8) * self.look.unit)
        found: Any = None
        if one.kind == "truth":
            pressed, found = imgui.checkbox(f"##{one.path}", bool(shown))
            self._place(one.path)
            found = bool(found) if pressed else None
        elif one.kind == "word":
            found = self._word(one, str(shown))
        else:
            found = self._number(one, shown)
        if told is not None and told != now and self._reset(one.path):
            state.pending.pop(one.path, None)
            return told
        return found

    def _word(self, one: Parameter, now: str) -> str | None:
        imgui, chosen = self.imgui, None
        if imgui.begin_combo(f"##{one.path}", now):
            for word in one.words:
                pressed, _ = imgui.selectable(word, word == now)
                chosen = word if pressed and word != now else chosen
            imgui.end_combo()
        self._place(one.path)
        return chosen

    def _number(self, one: Parameter, shown: Any) -> Any:
        imgui, pending = self.imgui, self.state.pending
        if one.kind == "vector":
            changed, found = imgui.slider_float3(
                f"##{one.path}", [float(part) for part in shown], one.low, one.high, "%.3g"
            )
            self._place(one.path)
            new: Any = tuple(rounded(part) for part in found)
        elif one.kind == "whole":
            changed, found = imgui.slider_int(f"##{one.path}", int(shown), int(one.low), int(one.high), "%d")
            self._place(one.path)
            new = int(found)
        else:
            changed, found = self._drag(one.path, shown, one.low, one.high, one.unit, one.logarithmic)
            new = rounded(found)
        if one.live:
            return new if changed else None
        if changed:
            pending[one.path] = new
        if imgui.is_item_deactivated() and one.path in pending:
            return pending.pop(one.path)
        return None

    def _reset(self, path: str) -> bool:
        """The button at the right: an arrow back, drawn, since not every font has one."""
        imgui, unit = self.imgui, self.look.unit
        imgui.same_line()
        height = imgui.get_frame_height()
        pressed = imgui.invisible_button(f"reset {path}", imgui.ImVec2(RESET * unit, height))
        self._place(f"reset {path}")
        colour = self.look.colour(imgui, "accent" if imgui.is_item_hovered() else "faint")
        low = imgui.get_item_rect_min()
        x, y, r = low.x + RESET * unit / 2, low.y + height / 2, 5 * unit
        lines = imgui.get_window_draw_list()
        lines.path_arc_to((x, y), r, -2.2, 2.6, 16)
        lines.path_stroke(colour, 1.6 * unit)
        tip_x, tip_y = x - 0.59 * r, y - 0.81 * r
        a = 4.2 * unit
        corners = ((-a, 0.3 * a), (0.5 * a, -a), (0.6 * a, 0.7 * a))
        lines.add_triangle_filled(*((tip_x + right, tip_y + down) for right, down in corners), colour)
        self.tip("back to what the scene says")
        return bool(pressed)


def _tip(one: Parameter) -> str:
    lines = [f"{one.path}{f': {one.note}' if one.note else ''}"]
    if one.kind in ("number", "whole") and one.high > one.low:
        lines.append(
            f"slider {one.low:.4g} to {one.high:.4g} {one.unit}".rstrip() + "; Ctrl and a click: type a number"
        )
    if not one.live:
        lines.append(f"not live: {one.why}, so the world is opened anew when it is let go, with the state as it is")
    return "\n".join(lines)
