"""The name of a method, from its table in the store."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def name_of(method: Mapping[str, Any]) -> str:
    """Return the name of a method from its table, as stores have it."""
    ordering = method.get("scheme") or method.get("ordering")
    return str(method.get("integrator") or (f"{method['solver']} {ordering}" if ordering else method["solver"]))
