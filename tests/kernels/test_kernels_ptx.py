"""CUDA kernels compile without a GPU where the compiler is there, and leave no trace of what they do not need.

No double in float32, no local memory and no call, atomics where particles are counted alone and on whole numbers, and in
exact math no product that may run into a sum. ptx_rows.py has the kernels.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from kernel_text import kernel_text
from ptx_rows import SOME, Row, rows

pytestmark = pytest.mark.usefixtures("ptx_compiler")
SINGLE, DOUBLE = np.float32, np.float64


def named(kinds: Counter[str], row: Row, kernel: str) -> str:
    """A name for a row's kernel: its factory's, and a number where there are several."""
    name = f"{row.factory.rpartition('.')[2].replace(':make', '')}-{kernel}".rstrip("-*")
    kinds[name] += 1
    return f"{name}-{kinds[name]}"


def lean_cases() -> Iterator[Any]:
    """By default a kernel in fast or exact math of float32 in turn, and the first of every third row in float64."""
    kinds: Counter[str] = Counter()
    for number, row in enumerate(row for row in rows() if row.lean):
        for place, kernel in enumerate(row.letters):
            name = named(kinds, row, kernel)
            usual = "fast" if kernel in row.counts or (number + place) % 2 else "exact"
            for real, math in ((SINGLE, "fast"), (SINGLE, "exact"), (DOUBLE, "exact")):
                wanted = math == usual if real is SINGLE else place == 0 and number % 3 == 0
                marks = [] if wanted and not row.rare else [pytest.mark.rest]
                yield pytest.param(row, kernel, real, math, id=f"{name}-{real.__name__}-{math}", marks=marks)


def counted_cases() -> Iterator[Any]:
    kinds: Counter[str] = Counter()
    for row in rows():
        for real, counts in ((SINGLE, row.counts), (DOUBLE, row.double_counts)):
            for kernel in counts:
                marks = [pytest.mark.rest] if row.rare else []
                name = f"{named(kinds, row, kernel)}-{real.__name__}"
                yield pytest.param(row, kernel, real, counts[kernel], id=name, marks=marks)


def contractible(text: str) -> set[str]:
    """Products that the assembler may contract into a sum: neither has its own rounding."""
    products = re.findall(r"\bmul\.(?:ftz\.)?f\d+\s+(%\w+),", text)
    sums = re.findall(r"\b(?:add|sub)\.(?:ftz\.)?f\d+\s+%\w+, (%\w+), (%\w+);", text)
    return set(products) & {operand for pair in sums for operand in pair}


WHOLE = (".u32", ".s32", ".b32", ".u64", ".s64", ".b64")  # ends of atomics on whole numbers


@pytest.mark.parametrize("row, kernel, real, math", list(lean_cases()))
def test_a_kernel_holds_nothing_that_it_does_not_need(row: Row, kernel: str, real: Any, math: str) -> None:
    made = row.kernels(real, math)
    for name, one in made.items() if kernel == "*" else [(kernel, made[kernel])]:
        text = kernel_text(one, row.letters[kernel], real, math)
        words = {".local", "call"} - row.allowed
        if real is SINGLE:
            words.add(".f64")
        elif math == "exact":  # float64's quotients and roots are instructions
            words.add("fma.rn.f64")
        assert not [word for word in words if word in text], name
        assert math == "fast" or not contractible(text), name
        atomics = re.findall(r"\b(?:atom|red)\.\S+", text)
        assert bool(atomics) == (name in row.atomics)
        assert not [word for word in atomics if not word.endswith(WHOLE)], name


@pytest.mark.parametrize("row, kernel, real, counts", list(counted_cases()))
def test_a_kernel_holds_what_it_needs_as_often_as_it_must(row: Row, kernel: str, real: Any, counts: Any) -> None:
    text = kernel_text(row.kernels(real, "fast")[kernel], row.letters[kernel], real, "fast")
    found = {word: text.count(word) for word in counts}
    assert {word: min(found[word], 1) if count == SOME else found[word] for word, count in counts.items()} == {
        word: 1 if count == SOME else count for word, count in counts.items()
    }
