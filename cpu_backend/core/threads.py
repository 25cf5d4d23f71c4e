"""Number of threads, the words for it such as `2x`, and how idle threads wait.

numba reads NUMBA_NUM_THREADS once, when it is imported, and later can only use fewer. So this module, which is imported
before numba, requests four times the cores. If numba was imported first (in a notebook), a request for more is an error
with a remedy.

The OpenMP runtime also reads how to wait when it is loaded. By default GNU's spins for milliseconds, as long as the
time slice of another program: if two threads and that program share two cores, each synchronisation may take a slice.
So idle threads are set to spin for microseconds and then to sleep, unless the user chose otherwise.
"""

from __future__ import annotations

import os
import sys
from collections.abc import MutableMapping

from softlab.model.base.errors import SceneError


def allowed_cores() -> frozenset[int]:
    """Return the numbers of the cores that this process may use."""
    try:
        return frozenset(os.sched_getaffinity(0))
    except AttributeError:  # not Linux
        return frozenset(range(os.cpu_count() or 1))


def core_count() -> int:
    """Return the number of cores that this process may use."""
    return len(allowed_cores())


MULTIPLES = {"1x": 1, "2x": 2, "4x": 4}

POLICY = "OMP_WAIT_POLICY"  # the user's choice: active or passive
SPIN_COUNT, BLOCK_TIME = "GOMP_SPINCOUNT", "KMP_BLOCKTIME"  # settings of GNU's and LLVM's runtimes
BRIEF = {SPIN_COUNT: "300", BLOCK_TIME: "0"}  # checks with a pause between, about 6 us; ms: LLVM's sleeps at once


def wait_briefly(environment: MutableMapping[str, str]) -> None:
    """Make idle threads spin for microseconds and then sleep, unless the user chose otherwise."""
    if POLICY in environment:
        for name, ours in BRIEF.items():  # set by our own parent process
            if environment.get(name) == ours:
                del environment[name]
    elif SPIN_COUNT not in environment and BLOCK_TIME not in environment:
        environment.update(BRIEF)


def policy_of(environment: MutableMapping[str, str]) -> str:
    """Return the policy of an environment (see wait_policy)."""
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
    """Return the number of threads for `1x`, `2x`, `4x` (times the cores) or a number. app/driver.py handles `auto`.

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
    """Return the wait policy of idle OpenMP threads.

    `brief`: spin for microseconds, then sleep, the lab's own choice; `passive` (sleep) or `active` (spin): set by
    OMP_WAIT_POLICY; `custom`: set by GOMP_SPINCOUNT or KMP_BLOCKTIME; `default`: spin for milliseconds, as numba was
    imported before the lab.
    """
    return _policy


def threading_layer() -> str:
    """Return the layer numba runs on (`omp`, `tbb`, `workqueue`); starts it if nothing has yet."""
    import numba

    try:
        return numba.threading_layer()
    except ValueError:  # nothing parallel has run in this process
        numba.get_num_threads()  # starts the threads
        return numba.threading_layer()
