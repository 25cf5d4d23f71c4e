"""Marks of samples whose state is wrong, so that their time does not count; other marks only mean noise."""

from __future__ import annotations

INCOMPLETE = "incomplete"  # contacts were lost, or elements are inverted or caught: begins such a mark
WRONG = ("wrong answer", "state not finite", INCOMPLETE)


def is_wrong(mark: str | None) -> bool:
    """Return True if one of a sample's marks, joined by "; ", means that its state is wrong."""
    return any(reason.startswith(WRONG) for reason in (mark or "").split("; "))
