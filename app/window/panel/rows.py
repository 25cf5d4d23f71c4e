"""Rows of the panel: a name at the left and a widget at the right; buttons; lines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import ModuleType

from softlab.app.window.panel.scene_list import Entry, matching
from softlab.app.window.panel.state import PanelState
from softlab.app.window.panel.style import PanelStyle

NAME, TIP = 126.0, 300.0  # units: of the names' column, of the text of a tooltip


class Rows:
    """Rows of a panel in the frame that is being laid out. Widgets return a new value if it changed, else None."""

    def __init__(self, imgui: ModuleType, style: PanelStyle, state: PanelState):
        self.imgui, self.style, self.state = imgui, style, state

    # ------------------------------------------------------------------ text

    def bold(self, text: str, size: float = 15.0) -> None:
        """Write a line in bold type of `size` units."""
        self.imgui.push_font(self.style.bold, size)
        self.imgui.text_unformatted(text)
        self.imgui.pop_font()

    def note(self, text: str, colour: str = "faint", size: float = 13.0) -> None:
        """Write wrapped lines in a faint colour."""
        imgui = self.imgui
        imgui.push_font(self.style.plain, size)
        imgui.push_style_color(int(imgui.Col_.text), self.style.colour(imgui, colour))
        imgui.push_text_wrap_pos(0.0)
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
        imgui.pop_style_color()
        imgui.pop_font()

    def heading(self, text: str) -> None:
        """Write the heading of a group of rows."""
        self.gap(1)
        self.imgui.push_font(self.style.bold, 13.0)
        self.imgui.push_style_color(int(self.imgui.Col_.text), self.style.colour(self.imgui, "faint"))
        self.imgui.text_unformatted(text)
        self.imgui.pop_style_color()
        self.imgui.pop_font()

    def gap(self, units: float) -> None:
        """Leave empty space."""
        self.imgui.dummy(self.imgui.ImVec2(1, units * self.style.unit))

    def value(self, name: str, text: str, colour: str = "ink") -> None:
        """Write a number that is read-only."""
        self.name(name)
        imgui = self.imgui
        imgui.push_style_color(int(imgui.Col_.text), self.style.colour(imgui, colour))
        imgui.push_text_wrap_pos(0.0)
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
        imgui.pop_style_color()

    def tip(self, text: str) -> None:
        """Explain the last item while the pointer rests on it. The text lies left of the panel, over the scene; below
        the pointer it would cover the rows in which the result of a press appears."""
        imgui = self.imgui
        if not text or not imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            return
        edge, gap = imgui.get_window_pos().x - 24 * self.style.unit, 2 * imgui.get_style().window_padding.x
        imgui.set_next_window_pos((edge, imgui.get_item_rect_min().y), 0, (1.0, 0.0))
        imgui.begin_tooltip()
        imgui.push_text_wrap_pos(max(min(TIP * self.style.unit, edge - gap), 60.0))
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
        low, size = imgui.get_window_pos(), imgui.get_window_size()
        self.state.places["tooltip"] = low.x, low.y, low.x + size.x, low.y + size.y
        imgui.end_tooltip()

    def name(self, name: str, tip: str = "") -> None:
        imgui = self.imgui
        imgui.align_text_to_frame_padding()
        imgui.text_unformatted(name)
        self.tip(tip)
        imgui.same_line(NAME * self.style.unit)

    def record_place(self, name: str) -> None:
        """Record the place of the last widget."""
        low, high = self.imgui.get_item_rect_min(), self.imgui.get_item_rect_max()
        self.state.places[name] = low.x, low.y, high.x, high.y

    # ------------------------------------------------------------------ what can be pressed

    def button(self, text: str, width: float = 0.0, on: bool = False, name: str = "") -> bool:
        """Draw a button and return True if it was pressed; `width` in pixels, `on`: it stands out."""
        imgui = self.imgui
        if on:
            for part in ("button", "button_hovered", "button_active"):
                imgui.push_style_color(int(getattr(imgui.Col_, part)), self.style.colour(imgui, "accent"))
            imgui.push_style_color(int(imgui.Col_.text), self.style.colour(imgui, "on_accent"))
        pressed = bool(imgui.button(f"{text}##{name or text}", imgui.ImVec2(width, 0)))
        if on:
            imgui.pop_style_color(4)
        self.record_place(name or text)
        return pressed

    def buttons(self, names: Sequence[str], on: str = "", prefix: str = "") -> str:
        """Draw a row of buttons as wide as the column; one may be highlighted. Returns the label of the pressed button,
        or ""."""
        imgui, chosen = self.imgui, ""
        gap = imgui.get_style().item_spacing.x
        width = (imgui.get_content_region_avail().x - gap * (len(names) - 1)) / len(names)
        for number, name in enumerate(names):
            if number:
                imgui.same_line()
            if self.button(name, width, name == on, f"{prefix}{name}"):
                chosen = name
        return chosen

    def check(self, name: str, on: bool, tip: str = "") -> bool:
        """Draw a check box and return True if it was pressed."""
        pressed, _ = self.imgui.checkbox(name, on)
        self.record_place(name)
        self.tip(tip)
        return bool(pressed)

    def choice(self, name: str, now: str, words: Sequence[str], tip: str = "", height: int = 12) -> str | None:
        """Draw a list of words and return a newly chosen one."""
        imgui = self.imgui
        self.name(name, tip)
        imgui.set_next_item_width(-1)
        imgui.set_next_window_size_constraints((0, 0), (1e4, height * imgui.get_frame_height_with_spacing()))
        return self.list_of_words(name, now, words)

    def list_of_words(self, name: str, now: str, words: Sequence[str]) -> str | None:
        """Draw the list of `choice` without its name and return a newly chosen word."""
        imgui, chosen = self.imgui, None
        if imgui.begin_combo(f"##{name}", now):
            for word in words:
                pressed, _ = imgui.selectable(word, word == now)
                if pressed:
                    chosen = word
                if word == now:
                    imgui.set_item_default_focus()
            if self.state.cancels:
                imgui.close_current_popup()
            imgui.end_combo()
        self.record_place(name)
        return chosen if chosen != now else None

    def scene_choice(
        self, name: str, now: str, offer: Callable[[], Sequence[Entry]], tip: str = "", height: int = 16
    ) -> str | None:
        """Draw a list of scenes with a search field, as wide as the column. `now`: the text of the closed list;
        `offer`: called when the list opens. Returns the name of the chosen scene; Enter chooses the first one."""
        imgui, state, chosen = self.imgui, self.state, None
        imgui.set_next_item_width(-1)
        imgui.set_next_window_size_constraints((0, 0), (1e4, height * imgui.get_frame_height_with_spacing()))
        opened = imgui.begin_combo(f"##{name}", now)
        if opened:
            if imgui.is_window_appearing():
                state.search, state.entries = "", list(offer())
                imgui.set_keyboard_focus_here()
            imgui.set_next_item_width(-1)
            _, state.search = imgui.input_text_with_hint("##search", "search by title or name", state.search)
            self.record_place(f"{name} search")
            matches = matching(state.entries, state.search)
            for entry in matches:
                pressed, _ = imgui.selectable(entry.label, False)
                self.record_place(f"{name} {entry.name}")
                chosen = entry.name if pressed else chosen
            if not matches:
                self.note(
                    "no scene of this name can be shown here" if state.search else "no other scene can be shown here"
                )
            if state.search and matches and imgui.is_key_pressed(imgui.Key.enter):
                chosen = matches[0].name
            if chosen or state.cancels:
                imgui.close_current_popup()
            imgui.end_combo()
        self.record_place(name)
        if not opened:
            self.tip(tip)
        return chosen

    def line(self, name: str, text: str, hint: str) -> str:
        """Draw a text field and return its current text."""
        self.name(name)
        self.imgui.set_next_item_width(-1)
        _, typed = self.imgui.input_text_with_hint(f"##{name}", hint, text)
        self.record_place(name)
        return str(typed)
