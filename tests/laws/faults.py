"""Laws that a solver breaks today, and the issue that names the fault: strict, so that a mended one shows. None is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lab import Lab
from rows import Row


@dataclass(frozen=True)
class Fault:
    """`breaks(row, case, lab)`: whether the law fails there."""

    law: str
    reason: str
    breaks: Callable[[Row, str, Lab], bool]


FAULTS: tuple[Fault, ...] = ()


def fault_of(law: str, row: Row, case: str, lab: Lab) -> str:
    """Why the law fails there, or ""."""
    return next((one.reason for one in FAULTS if one.law == law and one.breaks(row, case, lab)), "")
