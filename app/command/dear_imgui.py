"""Check for Dear ImGui, which lays out the panel of the demo. It is an optional dependency."""

from __future__ import annotations

from functools import cache
from types import ModuleType

from softlab.model.base.errors import BackendUnavailable

REMEDY = 'pip install -e ".[panel]"'


@cache
def panel_available() -> tuple[bool, str]:
    """Return (True if Dear ImGui is installed, its version or the reason why it does not load)."""
    try:
        from imgui_bundle import imgui
    except Exception as error:  # an ImportError, or any error of a damaged installation
        return False, f"no panel in softlab demo ({type(error).__name__}: {' '.join(str(error).split())})"
    return True, f"Dear ImGui {imgui.get_version()}"


def load_imgui() -> ModuleType:
    """Return the module `imgui`. Raises BackendUnavailable."""
    works, reason = panel_available()
    if not works:
        raise BackendUnavailable(reason, REMEDY)
    from imgui_bundle import imgui

    return imgui
