"""Ctrl-C during the imports: one line and status 130, as later.

softlab/cli.py imports it before all else. `exit_status` (command_line.py) takes over when the command begins.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType

STOPPED = 130  # the exit status


def _leave(_signal: int, _frame: FrameType | None) -> None:
    os.write(2, b"softlab: stopped\n")  # nothing has begun that could be left half done
    os._exit(STOPPED)


def install_interrupt_handler() -> None:
    """Install the handler in a process that was started as `softlab` or `python -m softlab`; others that import this module
    keep theirs."""
    folder, name = os.path.split(os.path.splitext(sys.argv[0])[0])
    module = name == "__main__" and os.path.basename(folder) == "softlab"
    if (name == "softlab" or module) and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, _leave)
