"""One line of the output of `softlab doctor`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One line of the doctor: the thing that was checked, whether it works, what was found, and the remedy if it does
    not."""

    name: str
    works: bool
    detail: str
    remedy: str = ""
