"""Common parts of the commands of softlab/cli.py and bench/*commands.py: options of several of them, consoles, and error
messages."""

from __future__ import annotations

import errno
import os
import re
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer
from rich.console import Console
from typer.core import TyperGroup

from softlab.app.command.console import Output
from softlab.app.command.help_values import name_values
from softlab.model.base.errors import SoftlabError, on_command_line, shown
from softlab.model.domains.launched import launched_rank

if TYPE_CHECKING:
    from softlab.model.scene.scene import Scene

errors = Console(stderr=True, highlight=False, soft_wrap=True)
out = Output(highlight=False)

PLAINER = {  # messages of pydantic, typer or click about an argument, as patterns, and plainer ones
    r"Option '--record' requires 2 arguments\.": "--record needs two words: --record every=N FILE.npz",
    r"Missing argument 'SCENE'\.": "SCENE is missing: give a name that `softlab scenes` lists, or a .toml file",
    r"Missing argument": "missing argument:",
    r"Got unexpected extra argument(\(s\)|s)?": "unexpected argument, or an option that lacks its value:",
    r"Input should be a valid integer, unable to parse string as an integer|'[^']*' is not a valid integer\.": (
        "must be a whole number"
    ),
    r"Input should be a valid number, unable to parse string as a number|'[^']*' is not a valid float\.": "must be a number",
}
# base class of all complaints about a command line; typer exports only some of them
UsageError: type[Exception] = typer.BadParameter.mro()[2]
SceneName = Annotated[str, typer.Argument(metavar="SCENE", help="A name that `softlab scenes` lists, or a .toml file.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a field, e.g. grid.rows=64. Repeatable."),
]
Backend = Annotated[str, typer.Option(help="cpu or gpu.")]
Threads = Annotated[
    str,
    typer.Option(
        help="CPU threads: 1x, 2x or 4x the number of cores, a number, or auto (the faster of 1x and 1, measured)."
    ),
]
Precision = Annotated[str, typer.Option(help="float32 or float64.")]
Math = Annotated[str, typer.Option(help="fast, or exact (the same bits on every backend and thread count).")]
StorePath = Annotated[Path, typer.Option("--store", help="Database file of the measurements (SQLite).")]
DEFAULT_STORE = Path("softlab-results") / "results.sqlite"


def scene_of(name: str, settings: list[str] | None) -> Scene:
    """Return the scene of that name or file, with the fields of --set. Raises SceneError."""
    from softlab.app.command.waiting import waiting_shown
    from softlab.model.base.waiting import work
    from softlab.model.scene.reader import parse_settings
    from softlab.model.scene.scene import load_scene

    with waiting_shown(), work(f"reading {name}"):
        scene, changes = load_scene(name), parse_settings(settings)
        return scene.replace(changes) if changes else scene


def note_missing_store(store: Path, whose: str) -> None:
    """Say which measurements are used if the usual store does not exist."""
    if not store.exists() and store == DEFAULT_STORE:
        errors.print(f"nothing was measured on this machine yet: {whose} uses the measurements that come with the lab")


class _Left(Exception):
    """An exception that ended a command; typer passes it on unchanged."""


Click: TypeAlias = Any  # an object of click or of typer's copy of it, which depends on typer's version
RENAMED = {"crowds": "throughput"}  # former names of commands


class Commands(TyperGroup):
    """The sub-commands, also by their former names; `--help` names the values of their options.

    Ctrl-C and a closed reader reach `exit_status` unchanged: typer would turn them into exit statuses that depend on
    its version (1 or 130, and always 1).
    """

    def get_command(self, ctx: Click, cmd_name: str) -> Click:
        if cmd_name in RENAMED:
            errors.print(f"softlab {cmd_name} was renamed: use softlab {RENAMED[cmd_name]}")
        command = super().get_command(ctx, RENAMED.get(cmd_name, cmd_name))
        if command is not None:
            name_values(command.get_params(ctx), command.callback)
        return command

    def get_params(self, ctx: Click) -> Click:
        parameters = super().get_params(ctx)
        name_values(parameters, None)
        return parameters

    def invoke(self, ctx: Click) -> object:
        try:
            return super().invoke(ctx)
        except (KeyboardInterrupt, BrokenPipeError) as error:
            raise _Left from error


def _result(command: Callable[[], int | None]) -> int | None:
    try:
        return command()
    except _Left as left:
        raise left.__cause__ or left from None


@on_command_line()
def exit_status(command: Callable[[], int | None]) -> int:
    """Return the exit status of a command line; an error that a user can fix is printed in one line on standard
    error."""
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):  # when asked to end, tidy up as for Ctrl-C
            signal.signal(number, signal.default_int_handler)
    try:
        with warnings.catch_warnings():
            # overflows are checked where values are used, with clear messages; NumPy's warnings do not name the scene
            warnings.simplefilter("ignore", RuntimeWarning)
            status = _result(command) or 0
        sys.stdout.flush()  # here, where a full disk can still be reported
        return status
    except SoftlabError as error:
        return report_error(str(error), error.exit_status)
    except UsageError as error:
        return usage_status(error)
    except KeyboardInterrupt as stop:
        return report_error(str(stop) or "stopped", 130)
    except BrokenPipeError:  # the reader (head, less) has closed
        drop_output()
        return 0
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        drop_output()
        return report_error(
            f"{error.filename or 'the output'} cannot be written: {error.strerror}; free some disk space", 2
        )
    except MemoryError as error:
        return report_error(f"not enough memory ({error or 'none is left'}); use a smaller scene", 2)


def report_error(line: str, status: int) -> int:
    """Print the line on standard error, if that is writable, and return `status`; of several processes one prints."""
    if launched_rank():
        return status
    with suppress(OSError):
        errors.print(f"softlab: {line}", markup=False)
    return status


def usage_line(error: Click) -> str:
    """Return the error in a command line, in one line."""
    known = sys.argv[1:2] if sys.argv[1:2] and not sys.argv[1].startswith("-") else []
    command = error.ctx.command_path if getattr(error, "ctx", None) else " ".join(["softlab", *known])
    said = " ".join(error.format_message().split())
    for pattern, plainer in PLAINER.items():
        said = re.sub(pattern, plainer, said)
    if (option := _wrong_option(error)) is not None:
        said = said.replace(f"Invalid value for '{option[0]}'", f"{option[0]} = {shown(option[1])}")
    return str(SoftlabError(f"{said} (see {command} --help)"))


def _wrong_option(error: object) -> tuple[str, str] | None:
    """Return the option that an error message is about and its value, if it is on the command line."""
    for name in getattr(getattr(error, "param", None), "opts", ()):
        for place, word in enumerate(sys.argv):
            if word == name and place + 1 < len(sys.argv):
                return name, sys.argv[place + 1]
            if word.startswith(f"{name}="):
                return name, word.removeprefix(f"{name}=")
    return None


def usage_status(error: Click) -> int:
    """Print an error message about the command line and return the exit status; without words, the help was printed."""
    status = int(error.exit_code)
    return report_error(usage_line(error), status) if error.format_message() else status


def drop_output() -> None:
    """Drop pending output, as nothing more can be printed, so that the end of the process does not fail on it."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def compilations_shown(console: Console = errors) -> Iterator[None]:
    """Context manager that prints each kernel that is compiled to a terminal, and how long this took last time on this
    machine."""
    from softlab.app.command.waiting import waiting_shown
    from softlab.model.base.kernel_cache import watched

    def show(label: str, seconds: float | None) -> None:
        if console.is_terminal and (seconds is None or seconds >= 1.0):
            last = "for the first time here" if seconds is None else f"took {seconds:.0f} s last time"
            console.print(f"compiling {label}: {last}", markup=False)

    with watched(show), waiting_shown():
        yield


def typed() -> str:
    """Return the command as it was typed, for the store, without the store's path."""
    return without_store(["softlab", *sys.argv[1:]])


def without_store(words: Sequence[str]) -> str:
    """Return the words of a command without --store and its path."""
    before = ("", *words)
    remaining = (word for last, word in zip(before, words, strict=False) if "--store" not in (last, word))
    return " ".join(word for word in remaining if not word.startswith("--store="))
