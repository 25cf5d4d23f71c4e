"""Names of values in `--help`. By itself typer prints Python's types there: `<bool>` beside a flag, `<list[str]>`."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

VALUES = ((r"\bint\b", "N"), ("float", "NUMBER"), ("Path", "FILE"))  # pattern of an option's type, name of its value


class Parameter(Protocol):
    """An option or argument of click, or of typer's copy of it."""

    name: str
    metavar: str | None
    nargs: int
    required: bool
    opts: list[str]
    param_type_name: str


def name_values(parameters: Iterable[Parameter], command: Callable[..., object] | None) -> None:
    """Name the value of each option that has no `metavar`: none for a flag, N for an integer, and so on; a text is
    named after its option. `command` is the function whose signature has the types of the options."""
    types = inspect.signature(command, eval_str=True).parameters if command else {}
    for parameter in parameters:
        if parameter.param_type_name == "argument":  # its name stands beside it already, and braces in the usage
            name = f"{parameter.metavar or parameter.name}{'...' if parameter.nargs != 1 else ''}"
            usage = [name if parameter.required else f"[{name}]"]
            vars(parameter).update(display_type_rich=lambda ctx: None, get_usage_pieces=lambda ctx, usage=usage: usage)
        elif parameter.metavar is None:
            parameter.metavar = "" if getattr(parameter, "is_flag", False) else _name_of_value(parameter, types)


def _name_of_value(parameter: Parameter, types: Mapping[str, inspect.Parameter]) -> str:
    """Return the name that `--help` prints for the value of an option that is not a flag."""
    text = str(types[parameter.name].annotation.__origin__) if parameter.name in types else ""
    names = [name for pattern, name in VALUES if re.search(pattern, text)]
    return names[0] if names else parameter.opts[0].lstrip("-").replace("-", "_").upper()
