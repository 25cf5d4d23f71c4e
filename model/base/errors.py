"""Errors with a reason and a remedy.

Every error that a user can cause is one of these: one line with the fault and the remedy. The command line prints it
and exits with `exit_status`; nothing else is written. Messages are written with the options of the command line;
outside of it (`on_command_line`) they name the arguments of `open_simulation` instead.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from math import isfinite

LONGEST = 560  # characters of a message: a few lines of a terminal, for any length of key or file name
LONGEST_FIELD, LONGEST_VALUE = 120, 80
ARGUMENTS = {  # of `open_simulation`, which are options of commands, and the values that a message gives them
    "backend": "cpu|gpu", "precision": "float32|float64", "math": "fast|exact", "link": "flags|peer|nccl",
    "kernel": "one-block|[a-z]+", "threads": "[0-9]x|[0-9]+|auto", "gpus": "[0-9]+", "ranks": "[0-9]+",
    "exchange-every": "[0-9]+", "allow-unstable": "(?!)",
}  # fmt: skip
OPTION = re.compile(
    "|".join(rf"--(?P<{name.replace('-', '_')}>{name}\b)(?: (?:{value})\b)?" for name, value in ARGUMENTS.items())
)
SETTING = re.compile(r"--set ([\w.-]+)=([\w.+-]*\w)")
_speech = {"options": False}


@contextmanager
def on_command_line() -> Iterator[None]:
    """Context manager in which messages name options of the command line instead of arguments of Python."""
    before = _speech["options"]
    _speech["options"] = True
    try:
        yield
    finally:
        _speech["options"] = before


def in_python(message: str) -> str:
    """Return the message with arguments of `open_simulation` in place of options: `backend="gpu"` for `--backend gpu`."""

    def argument(match: re.Match[str]) -> str:
        name, (_, _, value) = str(match.lastgroup), match[0].partition(" ")
        literal = "True" if name == "allow_unstable" else _literal(value) if value else ""
        return f"{name}={literal}" if literal else name

    def change(match: re.Match[str]) -> str:
        return f'scene.replace({{"{match[1]}": {_literal(match[2])}}})'

    return OPTION.sub(argument, SETTING.sub(change, message))


def _literal(word: str) -> str:
    try:
        return f"{float(word):g}"
    except ValueError:
        return f'"{word}"'


def shortened(text: str, most: int = LONGEST) -> str:
    """Return `text` in at most `most` characters: its beginning and its end, which contain the fault and the remedy."""
    if len(text) <= most:
        return text
    length = most - len(" ... ")
    return f"{text[: length // 2].rstrip()} ... {text[-(length - length // 2) :].lstrip()}"


def shown(value: object) -> str:
    """Return a value for messages: on one line, at most LONGEST_VALUE characters."""
    try:
        text = repr(value)
    except (RecursionError, MemoryError):
        return f"({type(value).__name__}, nested too deep to be shown)"
    except ValueError:  # Python does not print integers of thousands of digits
        return f"({type(value).__name__}, too long to be shown)"
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."


class SoftlabError(Exception):
    """Base of every error that the lab raises on purpose; its `str()` is the line that a user reads."""

    exit_status = 2

    def __init__(self, message: str):
        message = message if _speech["options"] else in_python(message)
        # one line, printable and short, whatever a user's file contained
        printable = "".join(c if c.isprintable() else repr(c)[1:-1] for c in shortened(message, 4 * LONGEST))
        super().__init__(shortened(printable))


class SceneError(SoftlabError):
    """A field of a scene (or an option of a command) has an invalid value.

    Attributes: `field` (dotted path), `value` (as passed), `allowed` (accepted values, or a remedy).
    """

    def __init__(self, field: str, value: object, allowed: str):
        self.field, self.value, self.allowed = field, value, allowed
        value_text = "" if value is None else f" = {shown(value)}"  # without a value
        super().__init__(f"{shortened(field, LONGEST_FIELD)}{value_text}: {allowed}")


class InputError(SoftlabError):
    """A file, folder or store cannot be used; the message gives the reason and the remedy."""


class UnstableTimeStep(SceneError):
    """The step size exceeds the stability limit of the scene and integrator.

    `limit`: the largest stable step size [s]; `cause`, `advice`: from model/core/stability/diagnosis.py, where they
    say more than the default message.
    """

    def __init__(self, dt: float, limit: float, integrator: str, cause: str | None = None, advice: str | None = None):
        self.limit = limit
        if cause and advice:
            remedy = f"{cause}; {advice}"
        elif limit > 0:
            remedy = f"over the stability limit of {integrator} here; use dt <= {limit:.6g} s"
        else:
            remedy = f"{integrator} is unstable at every step size here; choose another integrator"
        super().__init__("method.dt", dt, remedy + ", or pass --allow-unstable to run it anyway")


class BackendUnavailable(SoftlabError):
    """The machine lacks a GPU, a driver, OpenGL, a font ...; the message says what is missing and how to get it."""

    exit_status = 3

    def __init__(self, missing: str, remedy: str):
        self.missing, self.remedy = missing, remedy
        super().__init__(f"{missing}; {remedy}")


class Diverged(SoftlabError):
    """The state diverged: a non-finite value, or a particle farther than 1e6 times the scene's size from its initial
    centre.

    Attributes: `step` (the first bad step, counted from the scene's start), `particle` (the lowest bad index), `limit`
    (the largest stable dt [s], or None where none is known), `cause` and `remedy` (with its number; from
    model/core/stability/diagnosis.py).
    """

    exit_status = 1

    def __init__(
        self,
        step: int,
        particle: int,
        dt: float,
        limit: float | None,
        cause: str | None = None,
        remedy: str | None = None,
    ):
        self.step, self.particle, self.dt, self.limit = step, particle, dt, limit
        if limit is None or not isfinite(limit):
            self.cause = cause or "no stability limit is known for it"
        elif dt > limit:
            self.cause = cause or "the step size is over the stability limit"
        else:
            self.cause = cause or f"dt is under the linear limit of {limit:.6g} s"
        over = limit is not None and 0 < limit < dt
        self.remedy = remedy or (f"use dt <= {limit:.6g} s" if over else "try half the step size")
        super().__init__(f"diverged at step {step}, particle {particle} (dt = {dt:.6g} s): {self.cause}; {self.remedy}")


class Incomplete(SoftlabError):
    """A run ended in a finite state with incomplete physics: contacts or neighbours were lost, or elements are inverted
    or trapped in others. `faults`: which, in a few words."""

    exit_status = 1

    def __init__(self, faults: str):
        self.faults = faults
        super().__init__(f"incomplete: {faults}; see the notes above, or pass --allow-incomplete to accept it")


@contextmanager
def naming(part: str, files: bool = False) -> Iterator[None]:
    """Raise errors of a part's fields, and with `files` of its file, with the part's name, which it does not know."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{part}.{error.field}", error.value, error.allowed) from None
    except InputError as error:
        if not files:
            raise
        raise InputError(f"{part}: {error}") from None
