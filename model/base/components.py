"""Modules that are imported by name at run time: those of layers above, and optional components. No import statement
names them."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from softlab.model.base.errors import BackendUnavailable

INSTALL = "install it: pip install --force-reinstall soft-body-lab"


def named(place: str) -> Any:
    """Return the object at `module:name`, or the module where no name is given, imported now. Raises ImportError."""
    module, _, name = place.partition(":")
    loaded = import_module(module)
    return getattr(loaded, name) if name else loaded


def component(place: str, option: str) -> Any:
    """Return `named(place)` of an optional component; `option` is the option that needs it.

    Raises BackendUnavailable if it is not installed.
    """
    try:
        return named(place)
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("softlab."):
            raise  # one of its own dependencies
        raise BackendUnavailable(f"{option} needs {error.name}, which is not installed", INSTALL) from None
