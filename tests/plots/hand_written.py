"""What was written by hand about the committed measurements, and must stay true of them.

Everything else in the lab book is chosen by the data and cannot be wrong about them. These can: README, docs and talks
lean on them, so CI checks them against labbook/data/, and a new measurement that contradicts one fails there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from softlab.labbook.claims import accuracy as accuracy_claims
from softlab.labbook.claims import claim as claims
from softlab.labbook.claims import comparison as comparison_claims
from softlab.labbook.claims.claim import Claim
from softlab.plots.core.data import Results, is_wrong
from softlab.plots.core.read import load


@dataclass(frozen=True)
class HandWritten:
    """`text`: the claim, as a person wrote it. `made_from`: what it rests on. `holds`: whether that bears it out."""

    text: str
    made_from: Callable[[Results], Claim]
    holds: Callable[[Claim], bool]


def no_wrong_answer(results: Results) -> Claim:
    """How many committed times belong to an answer that failed its check."""
    wrong = sum(is_wrong(timing) for source in results.sources for timing in source.timings)
    return Claim(f"{wrong} timings have a wrong answer.", {"wrong": wrong}, True)


HAND_WRITTEN = (
    HandWritten("no committed time belongs to a wrong answer", no_wrong_answer, lambda c: c.numbers["wrong"] == 0),
    HandWritten(
        "the GPU is faster at the largest size",
        comparison_claims.overtakes,
        lambda c: c.supported and c.numbers["ratio"] > 1,
    ),
    HandWritten(
        "4x threads are slower than 1x on the smallest grid",
        lambda results: claims.threads_at(results, 0),
        lambda c: c.numbers["4x"] > 1,
    ),
    HandWritten(
        "the hand-out's step has order 0 against Newton's law", accuracy_claims.lab_newton, lambda c: c.supported
    ),
    HandWritten("it has order 1 against half the acceleration", accuracy_claims.lab_half, lambda c: c.supported),
    HandWritten("the integrators reach their declared orders", accuracy_claims.orders, lambda c: c.supported),
)


def failures(paths: Iterable[Path]) -> list[str]:
    """Which hand-written claims the committed measurements contradict, or hold nothing about."""
    results = load(None, paths)
    failed = []
    for written in HAND_WRITTEN:
        claim = written.made_from(results)
        if not claim.numbers:
            failed.append(f"{written.text}: not measured ({claim.sentence})")
        elif not written.holds(claim):
            failed.append(f"{written.text}: the data say: {claim.sentence}")
    return failed
