"""Style of the panel: its font, distances and colours, light and dark, at any size. Everything is a multiple of one
unit, and nothing is Dear ImGui's default."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from softlab.app.render import colours

if TYPE_CHECKING:
    from imgui_bundle.imgui import ImFont

WIDTH = 372.0  # units: of the column
FONT_SIZE = 15.0  # units
SIZES = (1.0, 1.25, 1.5, 2.0, 3.0)  # pixels a unit, that can be chosen
RGB = tuple[float, float, float]


@dataclass(frozen=True)
class Theme:
    """Colours (0 to 1). `ground` of the column, `raised`, `hovered`, `pressed` of buttons and sliders; `ink`, `faint`
    of what is read last; `line` between; `accent` of what is set, `on_accent` upon it; `warning`; `physics`, `drawing`,
    `second` of curves."""

    ground: RGB
    raised: RGB
    hovered: RGB
    pressed: RGB
    ink: RGB
    faint: RGB
    line: RGB
    accent: RGB
    on_accent: RGB
    warning: RGB
    physics: RGB
    drawing: RGB
    second: RGB


LIGHT = Theme(
    ground=(0.975, 0.978, 0.983),
    raised=(0.905, 0.915, 0.930),
    hovered=(0.855, 0.875, 0.905),
    pressed=(0.790, 0.825, 0.875),
    ink=colours.INK,
    faint=(0.36, 0.40, 0.46),
    line=(0.83, 0.85, 0.88),
    accent=(0.16, 0.40, 0.68),
    on_accent=(1.0, 1.0, 1.0),
    warning=colours.WARNING,
    physics=(0.20, 0.43, 0.70),
    drawing=colours.DRAWING,
    second=(0.00, 0.47, 0.36),
)
DARK = Theme(
    ground=(0.105, 0.118, 0.137),
    raised=(0.185, 0.205, 0.235),
    hovered=(0.240, 0.268, 0.308),
    pressed=(0.300, 0.340, 0.395),
    ink=(0.915, 0.928, 0.945),
    faint=(0.62, 0.66, 0.71),
    line=(0.225, 0.247, 0.282),
    accent=(0.36, 0.62, 0.92),
    on_accent=(0.04, 0.07, 0.11),
    warning=(1.00, 0.58, 0.42),
    physics=(0.42, 0.66, 0.95),
    drawing=(0.92, 0.75, 0.38),
    second=(0.40, 0.80, 0.64),
)


@dataclass
class PanelStyle:
    """Colours and sizes of the panel: `theme`, `unit` [pixels], and the fonts `plain` and `bold` after `load_fonts`."""

    theme: Theme = LIGHT
    unit: float = 1.0
    plain: ImFont | None = None
    bold: ImFont | None = None

    @property
    def dark(self) -> bool:
        """True for the dark theme."""
        return self.theme is DARK

    @property
    def width(self) -> int:
        """Width of the column [pixels]."""
        return round(WIDTH * self.unit)

    def load_fonts(self, imgui: ModuleType) -> None:
        """Load Roboto, which comes with Dear ImGui's package; without it the built-in font."""
        import imgui_bundle

        folder = Path(imgui_bundle.__file__).parent / "assets" / "fonts" / "Roboto"
        atlas = imgui.get_io().fonts
        for name, file in (("plain", "Roboto-Regular.ttf"), ("bold", "Roboto-Bold.ttf")):
            if (folder / file).exists():
                setattr(self, name, atlas.add_font_from_file_ttf(str(folder / file), FONT_SIZE))

    def apply(self, imgui: ModuleType) -> None:
        """Make it the current context's style."""
        style, unit, theme = imgui.get_style(), self.unit, self.theme
        pairs = {
            "window_padding": (16, 12), "frame_padding": (9, 5), "item_spacing": (8, 6), "item_inner_spacing": (7, 4),
            "cell_padding": (4, 3),
        }  # fmt: skip
        for name, (x, y) in pairs.items():
            setattr(style, name, imgui.ImVec2(x * unit, y * unit))
        numbers = {
            "window_rounding": 0, "frame_rounding": 5, "grab_rounding": 4, "popup_rounding": 6, "scrollbar_rounding": 6,
            "scrollbar_size": 10, "grab_min_size": 3, "indent_spacing": 12, "window_border_size": 0,
            "popup_border_size": 1, "frame_border_size": 0,
        }  # fmt: skip
        for name, value in numbers.items():
            setattr(style, name, value * unit)
        style.font_size_base, style.font_scale_main = FONT_SIZE, unit
        style.hover_delay_normal = 0.35
        for names, colour in (
            ("text", theme.ink), ("text_disabled", theme.faint), ("window_bg popup_bg child_bg", theme.ground),
            ("border separator", theme.line), ("frame_bg button checkbox_selected_bg", theme.raised),
            ("frame_bg_hovered button_hovered", theme.hovered), ("frame_bg_active button_active", theme.pressed),
            ("slider_grab slider_grab_active check_mark text_link", theme.accent),
            ("header", theme.ground), ("header_hovered", theme.raised), ("header_active", theme.hovered),
            ("scrollbar_bg", theme.ground), ("scrollbar_grab", theme.hovered),
            ("scrollbar_grab_hovered scrollbar_grab_active", theme.pressed),
            ("text_selected_bg nav_cursor tree_lines", theme.pressed), ("input_text_cursor", theme.ink),
        ):  # fmt: skip
            for name in names.split():
                style.set_color_(int(getattr(imgui.Col_, name)), imgui.ImVec4(*colour, 1.0))

    def colour(self, imgui: ModuleType, name: str, alpha: float = 1.0) -> int:
        """Return a colour of the theme in Dear ImGui's packed form."""
        return int(imgui.color_convert_float4_to_u32(imgui.ImVec4(*getattr(self.theme, name), alpha)))
