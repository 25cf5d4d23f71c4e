"""Threads: how many there are to have, and how many a word such as `2x` means.

numba reads NUMBA_NUM_THREADS once, when it is imported, and can later only go below it. So this module, imported before
numba anywhere in the lab, asks for four times the cores. Where numba came first (a notebook), asking for more than it
holds is an error that says what to do.
"""

from __future__ import annotations

import os
import sys

from model.errors import SceneError


def core_count() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not Linux
        return os.cpu_count() or 1


MULTIPLES = {"1x": 1, "2x": 2, "4x": 4}

if "numba" not in sys.modules:
    os.environ.setdefault("NUMBA_NUM_THREADS", str(4 * core_count()))


def thread_count(word: str | int) -> int:
    """Threads for `1x`, `2x`, `4x` (times the cores) or a number.

    Raises SceneError for any other word, and for more threads than numba was started with.
    """
    text = str(word).strip()
    if text in MULTIPLES:
        count = MULTIPLES[text] * core_count()
    elif text.isascii() and text.isdigit() and int(text) >= 1:
        count = int(text)
    else:
        raise SceneError("--threads", word, "must be 1x, 2x, 4x (times the cores) or a number of at least 1")
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
    """What idle OpenMP threads do: `passive` (sleep), `active` (spin), or `default` (spin for a while)."""
    return os.environ.get("OMP_WAIT_POLICY", "default").lower()


def threading_layer() -> str:
    """The layer numba runs on (`omp`, `tbb`, `workqueue`); starts it if nothing has yet."""
    import numba

    try:
        return numba.threading_layer()
    except ValueError:  # nothing parallel has run in this process
        numba.get_num_threads()  # starts them
        return numba.threading_layer()
