"""The processor that the threads run on."""

from __future__ import annotations

import platform
from functools import cache


@cache
def processor_name() -> str:
    """Return the name that the processor reports."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
