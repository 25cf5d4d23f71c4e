"""Marks of samples that say more than that a time is noisy: the answer is wrong, so the time wins nothing."""

from __future__ import annotations

INCOMPLETE = "incomplete"  # contacts were lost, or elements are inverted or caught: begins such a mark
WRONG = ("wrong answer", "state not finite", INCOMPLETE)


def is_wrong(mark: str | None) -> bool:
    """Return True if one of a sample's marks, which are joined by "; ", says that its state is wrong."""
    return any(reason.startswith(WRONG) for reason in (mark or "").split("; "))
