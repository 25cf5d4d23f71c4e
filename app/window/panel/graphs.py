"""The panel's graphs: frame times as bars, physics and drawing separately, and curves over time."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from softlab.app.window.frame_times import BUDGET, FrameTimes
from softlab.app.window.panel.style import PanelStyle

if TYPE_CHECKING:
    from imgui_bundle.imgui import ImDrawList

HEIGHT = 74.0  # units
NUMBER_MARGIN = 16.0  # units, over and under a curve for its numbers


def _frame(imgui: ModuleType, style: PanelStyle, height: float) -> tuple[ImDrawList, float, float, float, float]:
    """Draw an empty field as wide as the column. Returns (draw list, left, top, width, height) [pixels]."""
    corner, width = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail().x
    tall = height * style.unit
    imgui.dummy(imgui.ImVec2(width, tall))
    lines = imgui.get_window_draw_list()
    lines.add_rect_filled(
        (corner.x, corner.y), (corner.x + width, corner.y + tall), style.colour(imgui, "raised", 0.55), 5 * style.unit
    )
    return lines, corner.x, corner.y, width, tall


def _small(
    imgui: ModuleType, style: PanelStyle, x: float, y: float, text: str, colour: str, right: bool = False
) -> None:
    """Write a word of a graph that starts or ends at `x`."""
    imgui.push_font(style.plain, 12.0)
    across = imgui.calc_text_size(text).x if right else 0.0
    imgui.get_window_draw_list().add_text((x - across, y), style.colour(imgui, colour), text)
    imgui.pop_font()


def _digits(number: float) -> str:
    """Return a number with at least two digits and without an exponent."""
    return f"{number:.0f}" if number >= 10 else f"{number:.2g}"


def frame_times(imgui: ModuleType, style: PanelStyle, times: FrameTimes) -> None:
    """Draw the last frames: one bar each, drawing on top of physics, and the line of 60 frames/s."""
    lines, left, top, width, tall = _frame(imgui, style, HEIGHT)
    unit, most = style.unit, times.range
    inner, base = tall - NUMBER_MARGIN * unit, top + tall - 3 * unit
    each = (width - 6 * unit) / len(times.seconds)
    physics, drawing = style.colour(imgui, "physics"), style.colour(imgui, "drawing")
    for number, (one, other) in enumerate(times.seconds.tolist()):
        if one + other <= 0:
            continue
        x = left + 3 * unit + number * each
        low, high = min(one / most, 1.0) * inner, min((one + other) / most, 1.0) * inner
        wide = max(each - 0.7 * unit, 1.0)
        lines.add_rect_filled((x, base - low), (x + wide, base), physics)
        lines.add_rect_filled((x, base - high), (x + wide, base - low), drawing)
    line = base - BUDGET / most * inner
    lines.add_line((left, line), (left + width, line), style.colour(imgui, "warning", 0.8), unit)
    recent = 1e3 * times.seconds[-30:].mean(axis=0)
    x = left + 6 * unit
    for text, colour in (
        (f"physics {_digits(recent[0])} ms", "physics"),
        (f"drawing {_digits(recent[1])} ms", "drawing"),
    ):
        _small(imgui, style, x, top + 1 * unit, text, colour)
        imgui.push_font(style.plain, 12.0)
        x += imgui.calc_text_size(text).x + 12 * unit
        imgui.pop_font()
    corner = left + width - 48 * unit, line - 15 * unit
    lines.add_rect_filled(corner, (left + width, line - unit), style.colour(imgui, "ground", 0.85), 3 * unit)
    _small(imgui, style, left + width - 4 * unit, line - 15 * unit, f"{1e3 * BUDGET:.1f} ms", "warning", right=True)


def curves(
    imgui: ModuleType,
    style: PanelStyle,
    title: str,
    unit_word: str,
    time: np.ndarray,
    shown: Sequence[tuple[str, str, np.ndarray]],
) -> None:
    """Draw curves over `time` [s], each (name, colour, values), under a `title`; the last values in figures."""
    lines, left, top, width, tall = _frame(imgui, style, HEIGHT)
    unit = style.unit
    x = left + 6 * unit
    _small(imgui, style, x, top + 1 * unit, title, "faint")
    edge = left + width - 6 * unit
    for name, colour, values in reversed(shown):
        last = f"{values[-1]:.4g}" if len(values) else "-"
        text = f"{name} {last} {unit_word}".strip()
        _small(imgui, style, edge, top + 1 * unit, text, colour, right=True)
        imgui.push_font(style.plain, 12.0)
        edge -= imgui.calc_text_size(text).x + 12 * unit
        imgui.pop_font()
    finite = [values[np.isfinite(values)] for _, _, values in shown]
    every = np.concatenate(finite) if finite else np.zeros(0)
    if len(time) < 2 or not len(every):
        return
    low, high = min(float(every.min()), 0.0), max(float(every.max()), 0.0)
    extent = (high - low) or 1.0
    inner, base = tall - (NUMBER_MARGIN + 6) * unit, top + tall - 4 * unit
    ground = base + low / extent * inner
    lines.add_line((left, ground), (left + width, ground), style.colour(imgui, "line"), unit)
    span = float(time[-1] - time[0]) or 1.0
    across = left + 4 * unit + (time - time[0]) / span * (width - 8 * unit)
    for _, colour, values in shown:
        up = base - (np.nan_to_num(values, nan=0.0, posinf=high, neginf=low) - low) / extent * inner
        points = [imgui.ImVec2(float(a), float(b)) for a, b in zip(across, up, strict=True)]
        lines.add_polyline(points, style.colour(imgui, colour), 1.6 * unit, 0)
