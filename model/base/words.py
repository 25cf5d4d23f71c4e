"""Wording of a scene's errors: errors of pydantic as a field, its value and the allowed values."""

from __future__ import annotations

import difflib
import inspect
import re
from collections.abc import Iterable
from functools import cache
from typing import Literal, get_args, get_origin

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from softlab.model.base.errors import SceneError
from softlab.model.base.table import Part

NOTE = r"^    (\w+): [^#\n]*  # (?!type:|noqa|fmt:)(.*)$"  # a field's comment

NEAR = 0.65  # of letters alike: below it cloth-hanging is near to nothing; far above it bar is not near to bat
SYNONYMS = {  # other programs' names of a field, whose letters are not similar to it
    "mesh": "file", "model": "file", "path": "file", "position": "origin", "rotation": "angle", "fixed": "pinned",
}  # fmt: skip
COUNTS = ("none", "one", "two", "three", "four")


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return ` (did you mean ...?)` with the nearest of `known` names, or "" if none is near."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=NEAR)
    return f" (did you mean {close[0]}?)" if close else ""


@cache
def notes_of(part: type[Part]) -> dict[str, str]:
    """Return the comment beside each field that has one, in the part's source and in those of its bases."""
    notes: dict[str, str] = {}
    for owner in reversed(part.__mro__):
        if issubclass(owner, Part) and owner is not Part:
            notes |= dict(re.findall(NOTE, inspect.getsource(owner), re.MULTILINE))
    return notes


def _kind_within(kind: type[Part], path: tuple[int | str, ...]) -> type[Part]:
    """Return the class of the part at a path: of a table inside a part, or of one in a list of tables.

    An index in a list does not change the class, nor does a field that is a word, such as the `shape` of a sink.
    """
    for step in path:
        if isinstance(step, str):
            within = kind.model_fields[step].annotation
            kind = next((choice for choice in (within, *get_args(within)) if hasattr(choice, "model_fields")), kind)
    return kind


def _names(kind: type[Part], place: tuple[int | str, ...]) -> list[str]:
    """Return the fields that lead to a complaint's place: a field of a part, and of the tables within it."""
    names: list[str] = []
    for step in place:
        if not isinstance(step, str) or step not in kind.model_fields:
            break
        names.append(step)
        within = kind.model_fields[step].annotation
        choices = [choice for choice in (within, *get_args(within)) if hasattr(choice, "model_fields")]
        if not choices:
            break
        kind = choices[0]
    return names


def _list_wanted(kind: type[Part], complaint: ErrorDetails) -> str:
    """Describe the list that a field must be where something else was given: of tables, words, or numbers, and how
    many."""
    place = _names(kind, complaint["loc"])
    if not place:
        return "must be a list"
    field = _kind_within(kind, tuple(place[:-1])).model_fields[place[-1]].annotation
    value, lists = complaint["input"], [choice for choice in (field, *get_args(field)) if get_origin(choice) is tuple]
    items = get_args(lists[0]) if lists else ()
    if any(hasattr(item, "model_fields") for item in items):
        return "must be a list of tables"
    if items and items[0] is str:
        return f'must be a list of words, such as ["{value if isinstance(value, str) else "left"}"]'
    count = len(items)
    if not items or Ellipsis in items or not isinstance(value, int | float) or isinstance(value, bool):
        return "must be a list of numbers, such as [0.0, 1.0, 0.0]"
    example = ", ".join([f"{value}"] * count)
    return f"must be a list of {COUNTS[count] if count < len(COUNTS) else count} numbers, such as [{example}]"


def _count_error(part: str, complaints: list[ErrorDetails], first: ErrorDetails) -> SceneError:
    """Return the error for a list of too few or too many numbers, with the number it must have.

    Each possible length of a field gives an error, and a short list one for each missing number.
    """
    counts: dict[tuple[int | str, ...], int] = {}
    for complaint in complaints:
        place = complaint["loc"]
        if complaint["type"] == "too_long":
            counts[place] = complaint["ctx"]["max_length"]
        elif complaint["type"] == "missing" and isinstance(place[-1], int):
            counts[place[:-1]] = max(place[-1] + 1, counts.get(place[:-1], 0))
    short = first["type"] == "missing"
    field = _field(first["loc"][:-1] if short else first["loc"])
    lengths = sorted({n for place, n in counts.items() if _field(place) == field})
    wanted = " or ".join(COUNTS[count] if count < len(COUNTS) else str(count) for count in lengths)
    reason = f"has too {'few' if short else 'many'} numbers: must have {wanted}"
    return SceneError(".".join([part, *field]), first["input"], reason)


def _field(place: tuple[int | str, ...]) -> list[str]:
    """Return the location of an error without the list type that pydantic inserts for unions."""
    return [str(step) for step in place if not str(step).startswith("tuple[")]


def _choices(kind: type[Part], name: str) -> str:
    """Return the words that a field may be, or "" if it is no choice among words."""
    field = kind.model_fields[name].annotation if name in kind.model_fields else None
    return ", ".join(map(str, get_args(field))) if get_origin(field) is Literal else ""


def scene_error(part: str, error: ValidationError, kind: type[Part]) -> SceneError:
    """Return the first complaint of pydantic as an error of a scene."""
    complaints = error.errors(include_url=False)  # a misspelt key explains the missing one
    first = next((c for c in complaints if c["type"] == "extra_forbidden"), complaints[0])
    location = [str(step) for step in first["loc"]]
    if first["type"] == "too_long" or (first["type"] == "missing" and isinstance(first["loc"][-1], int)):
        return _count_error(part, complaints, first)
    if first["type"] == "missing":
        place, name = first["loc"][:-1], location[-1]
        note = notes_of(_kind_within(kind, place)).get(name) or _choices(_kind_within(kind, place), name)
        return SceneError(".".join([part, *location]), None, f"must be given{f' ({note})' if note else ''}")
    if first["type"] == "extra_forbidden":
        known = list(_kind_within(kind, first["loc"][:-1]).model_fields)
        near = suggestion(location[-1], known)
        if SYNONYMS.get(location[-1]) in known:
            near = f" (did you mean {SYNONYMS[location[-1]]}?)"
        if location[1:] and location[-1] in kind.model_fields:
            near = f" (did you mean {part}.{location[-1]}?)"
        if not near and "shape" in known and location[-1] in _kind_within(kind, ("shape",)).model_fields:
            near = f" (did you mean {part}.shape.{location[-1]}?)"
        return SceneError(".".join([part, *location]), first["input"], f"unknown key{near}; known: {', '.join(known)}")
    message = first["msg"].removeprefix("Value error, ")
    if not location and ": " in message:  # a check across fields names its field itself
        field, _, allowed = message.partition(": ")
        return SceneError(
            f"{part}.{field}", first["input"].get(field) if isinstance(first["input"], dict) else None, allowed
        )
    words = {
        "int_type": "must be a whole number",
        "tuple_type": _list_wanted(kind, first),
        "int_from_float": "must be a whole number",
        "float_type": "must be a number",
        "finite_number": "must be a finite number",
        "bool_type": "must be true or false",
        "model_type": 'must be a table of its fields, such as { name = "star" }',
    }
    allowed = words.get(first["type"], message)
    if first["type"] == "float_type" and len(location) == 1 and (unit := notes_of(kind).get(location[0])):
        allowed += f" ({unit})"
    if first["type"] == "greater_than":
        allowed = f"must be greater than {first['ctx']['gt']:g}"
    elif first["type"] == "greater_than_equal":
        allowed = f"must be at least {first['ctx']['ge']:g}"
    elif first["type"] == "less_than_equal":
        allowed = f"must be at most {first['ctx']['le']:.12g}"
    elif first["type"] == "literal_error":
        choices = first["ctx"]["expected"]
        near = suggestion(str(first["input"]), re.findall("'([^']*)'", choices))
        allowed = f"must be one of {choices.replace(chr(39), '')}"
        allowed += " (a word, not a table)" if isinstance(first["input"], dict) else near
    return SceneError(".".join([part, *_names(kind, first["loc"])]), first["input"], allowed)
