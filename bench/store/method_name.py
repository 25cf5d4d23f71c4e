"""The name of a method, from its table in the store."""

from __future__ import annotations

from softlab.model.base.table import Tables


def name_of(method: Tables) -> str:
    """Return the name of a method from its table, as stores have it."""
    ordering = method.get("scheme") or method.get("ordering")
    return str(method.get("integrator") or (f"{method['solver']} {ordering}" if ordering else method["solver"]))
