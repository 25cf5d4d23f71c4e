"""Ctrl-C while the lab is still being imported: one line and status 130, as later on.

Imported before all else by softlab.py. `exit_status` (command_line.py) takes over when the command begins.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType

STOPPED = 130  # the exit status


def _leave(_signal: int, _frame: FrameType | None) -> None:
    os.write(2, b"softlab: stopped\n")  # nothing has begun that could be half done
    os._exit(STOPPED)


def answer_at_once() -> None:
    """In a process that was started as `softlab`; others that import it keep their own way."""
    started = os.path.splitext(os.path.basename(sys.argv[0]))[0] == "softlab"
    if started and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, _leave)
