"""Threads: how many there are to have, how many a word such as `2x` means, and how those wait that have nothing to do.

numba reads NUMBA_NUM_THREADS once, when it is imported, and can later only go below it. So this module, imported before
numba anywhere in the lab, asks for four times the cores. Where numba came first (a notebook), asking for more than it
holds is an error that says what to do.

The OpenMP runtime, too, reads how to wait when it is loaded. Left alone, GNU's spins for milliseconds, which is as long as
the time slice of another program: where two threads and that program share two cores, each meeting of the threads may
take a slice. So they are told to spin for microseconds and then to sleep, unless the user says otherwise.
"""

from __future__ import annotations

import os
import sys
from collections.abc import MutableMapping

from model.core.errors import SceneError


def allowed_cores() -> frozenset[int]:
    """Numbers of the cores that this process may use."""
    try:
        return frozenset(os.sched_getaffinity(0))
    except AttributeError:  # not Linux
        return frozenset(range(os.cpu_count() or 1))


def core_count() -> int:
    """Cores that this process may use."""
    return len(allowed_cores())


MULTIPLES = {"1x": 1, "2x": 2, "4x": 4}

POLICY = "OMP_WAIT_POLICY"  # the user's word: active or passive
SPIN_COUNT, BLOCK_TIME = "GOMP_SPINCOUNT", "KMP_BLOCKTIME"  # what GNU's and LLVM's runtimes ask for beside it
BRIEF = {SPIN_COUNT: "300", BLOCK_TIME: "0"}  # looks with a pause between, about 6 us; ms: LLVM's sleeps at once


def wait_briefly(environment: MutableMapping[str, str]) -> None:
    """Have idle threads spin for microseconds and then sleep, where the user has not said what they are to do."""
    if POLICY in environment:
        for name, ours in BRIEF.items():  # that of a process of ours which started this one
            if environment.get(name) == ours:
                del environment[name]
    elif SPIN_COUNT not in environment and BLOCK_TIME not in environment:
        environment.update(BRIEF)


def policy_of(environment: MutableMapping[str, str]) -> str:
    """See wait_policy."""
    if POLICY in environment:
        return environment[POLICY].lower()
    if SPIN_COUNT in environment or BLOCK_TIME in environment:
        return "brief" if all(environment.get(name) == ours for name, ours in BRIEF.items()) else "custom"
    return "default"


if "numba" not in sys.modules:
    os.environ.setdefault("NUMBA_NUM_THREADS", str(4 * core_count()))
    wait_briefly(os.environ)
_policy = policy_of(os.environ)  # as the runtime reads it


def thread_count(word: str | int) -> int:
    """Threads for `1x`, `2x`, `4x` (times the cores) or a number. (`auto` is app/driver.py's.)

    Raises SceneError for any other word, and for more threads than numba was started with.
    """
    text = str(word).strip()
    if text in MULTIPLES:
        count = MULTIPLES[text] * core_count()
    elif text.isascii() and text.isdigit() and int(text) >= 1:
        count = int(text)
    else:
        raise SceneError("--threads", word, "must be 1x, 2x, 4x (times the cores), auto, or a number of at least 1")
    import numba

    most = int(getattr(numba.config, "NUMBA_NUM_THREADS"))  # noqa: B009 - numba fills its config at run time
    if count > most:
        raise SceneError(
            "--threads",
            word,
            f"must be at most {most} here (NUMBA_NUM_THREADS, set before Python starts, allows more)",
        )
    return count


def wait_policy() -> str:
    """What idle OpenMP threads do: `brief` (spin for microseconds, then sleep: the lab's own choice), `passive` (sleep) or
    `active` (spin), as OMP_WAIT_POLICY said, `custom` (GOMP_SPINCOUNT or KMP_BLOCKTIME said), or `default` (spin for
    milliseconds: numba was there before the lab)."""
    return _policy


def threading_layer() -> str:
    """The layer numba runs on (`omp`, `tbb`, `workqueue`); starts it if nothing has yet."""
    import numba

    try:
        return numba.threading_layer()
    except ValueError:  # nothing parallel has run in this process
        numba.get_num_threads()  # starts them
        return numba.threading_layer()
