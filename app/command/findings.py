"""One line of what `softlab doctor` finds."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's: what was looked at, whether it works, what was found, how to get it if it does not."""

    name: str
    works: bool
    found: str
    remedy: str = ""
