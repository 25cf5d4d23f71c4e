"""What the command line makes of a case of any_input.py, with no solver, no measurement and no window behind it."""

from __future__ import annotations

import contextlib
import io
import os
import re
import signal
import sys
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from any_input import Case
from fake_cloth import FakeCloth

from softlab import cli
from softlab.bench.store.database import Store
from softlab.model.core.families import scene_plan
from softlab.model.core.simulation import Simulation

SECONDS = 20  # of computing that any answer may take; three times as many by the clock, for one that waits
PARTS = 10_000  # of a run that was asked to last, with its progress bar, until it counts as accepted
LONGEST = 600  # characters of a message


class Worked(BaseException):
    """Everything was accepted, and the work would begin now."""


class Hung(BaseException):
    """The answer takes too long."""


class Still(FakeCloth):
    """A solver that moves nothing."""

    kernel = "still"
    runs = 0

    def __init__(self, scene: Any, options: Any):
        self.plan = scene_plan(scene, options.live)
        Simulation.__init__(self, scene, options)
        self._velocity = np.array(self.body.velocity, dtype=float)
        self._position = self.body.position.copy()
        self.asked: list[str] = []
        self._put_aside()
        self.reset()

    def _run(self, steps: int) -> None:
        self.runs += 1
        if self.runs > PARTS:
            raise Worked


@contextlib.contextmanager
def quiet_lab() -> Iterator[None]:
    """No solver, no measurement, no window, while it lasts."""
    import softlab.app.driver
    import softlab.app.window.viewer
    import softlab.bench.measure.machine
    import softlab.bench.store.database

    def work(*_: Any, **__: Any) -> None:
        raise Worked

    replaced: list[tuple[Any, str, Any]] = [
        (softlab.app.driver, "_open", lambda scene, backend, options, threads: Still(scene, options)),
        (softlab.app.window.viewer, "run_demo", work),
        (softlab.bench.measure.machine, "measured_limits", work),
        (softlab.bench.store.database.Store, "start_run", work),
        (
            softlab.bench.store.database.Store,
            "add_machine",
            _machine_or_work(softlab.bench.store.database.Store.add_machine),
        ),
    ]
    kept = [(owner, name, getattr(owner, name)) for owner, name, _ in replaced]
    for owner, name, new in replaced:
        setattr(owner, name, new)
    try:
        yield
    finally:
        for owner, name, old in kept:
            setattr(owner, name, old)


def _machine_or_work(add: Any) -> Any:
    def entered(self: Store, key: str, label: str, record: Any) -> None:
        if isinstance(record, dict) and "cores" in record and "os" in record and "test" not in record:
            raise Worked
        add(self, key, label, record)

    return entered


@dataclass
class Answer:
    """What came back: the exit status (None: the work would have begun), what was printed, what is wrong with that."""

    status: int | None
    out: str
    err: str
    wrong: list[str]


def answer(case: Case, folder: Path) -> Answer:
    """What the command line makes of a case, run in `folder`."""
    out, err, wrong, status = io.StringIO(), io.StringIO(), [], None

    def hung(*_: Any) -> None:
        raise Hung

    argv, here = sys.argv, Path.cwd()
    before = set(_files(folder))
    timed = hasattr(signal, "SIGALRM")
    clocks = (
        ((signal.SIGALRM, signal.ITIMER_REAL, 3 * SECONDS), (signal.SIGPROF, signal.ITIMER_PROF, SECONDS))
        if timed
        else ()
    )
    old = [signal.signal(number, hung) for number, _, _ in clocks]
    try:
        os.chdir(folder)
        sys.argv = ["softlab", *case.argv]
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            for _, clock, seconds in clocks:
                signal.setitimer(clock, seconds)
            try:
                with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                    cli.main()
            except SystemExit as ended:
                status = int(ended.code or 0)
            except Worked:
                pass
            except Hung:
                wrong.append(f"took over {SECONDS} s")
                status = -1
            except BaseException as error:
                where = " < ".join(
                    f"{Path(frame.filename).name}:{frame.lineno}"
                    for frame in traceback.extract_tb(error.__traceback__)[:-9:-1]
                )
                wrong.append(f"traceback: {type(error).__name__}: {str(error)[:200]} at {where}")
                status = -1
            finally:
                for _, clock, _ in clocks:
                    signal.setitimer(clock, 0)
        wrong += [f"warning: {one.message} at {Path(one.filename).name}:{one.lineno}" for one in warned if _ours(one)]
    finally:
        sys.argv = argv
        os.chdir(here)
        for (number, _, _), handler in zip(clocks, old, strict=True):
            signal.signal(number, handler)
    wrong += _looked_at(case, status, err.getvalue())
    new = set(_files(folder)) - before
    hidden = [name for name in new if Path(name).name.startswith(".")]
    if hidden or (status not in (0, 1, None) and new):
        wrong.append(f"left behind: {sorted(new)}")
    return Answer(status, out.getvalue(), err.getvalue(), wrong)


def _ours(one: warnings.WarningMessage) -> bool:
    return not issubclass(one.category, ResourceWarning | DeprecationWarning)


def _files(folder: Path) -> list[str]:
    return [str(Path(root) / name) for root, _, names in os.walk(folder) for name in names]


def _looked_at(case: Case, status: int | None, err: str) -> list[str]:
    """What is wrong with a message."""
    if status in (None, 0, -1):
        return []
    wrong = []
    lines = err.strip().splitlines()
    told = [line for line in lines if line.startswith("softlab: ")]
    if status not in (1, 2, 3):
        wrong.append(f"status {status}")
    if len(told) != 1 or lines[-1] != told[0]:
        return [*wrong, f"not one line at the end: {err[-300:]!r}"]
    if len(told[0]) >= LONGEST:
        wrong.append(f"{len(told[0])} characters: {told[0][:100]}")
    if re.search(r"\b(inf|nan) s\b|Traceback|object at 0x", told[0]):
        wrong.append(f"tells nothing: {told[0]}")
    if status == 2 and not any(name in told[0] for name in case.names):
        wrong.append(f"names nothing of {case.names}: {told[0]}")
    return wrong
