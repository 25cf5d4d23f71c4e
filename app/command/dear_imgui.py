"""Dear ImGui, by which the panel of the demo is laid out: whether it is there. It comes with an extra."""

from __future__ import annotations

from functools import cache
from typing import Any

from model.core.errors import BackendUnavailable

REMEDY = 'pip install -e ".[panel]"'


@cache
def panel_available() -> tuple[bool, str]:
    """(whether Dear ImGui is there, its version or what keeps it from loading)."""
    try:
        from imgui_bundle import imgui
    except Exception as error:  # an ImportError, or whatever a damaged installation raises
        return False, f"no panel in softlab demo ({type(error).__name__}: {' '.join(str(error).split())})"
    return True, f"Dear ImGui {imgui.get_version()}"


def load_imgui() -> Any:
    """The module `imgui`. Raises BackendUnavailable."""
    works, told = panel_available()
    if not works:
        raise BackendUnavailable(told, REMEDY)
    from imgui_bundle import imgui

    return imgui
