"""CPU kernels as plain Python: the arithmetic that NumPy scalars do not share with machine code, and the switch."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Iterator
from math import sqrt

import numpy as np
import pytest
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.plain import SECONDS, SWITCH, TooLong, is_plain, plain_python
from softlab.cpu_backend.core.progress import assigned, exchange, load_acquire, new_flags, new_team, store_release


@pytest.fixture(autouse=True)
def plain() -> Iterator[None]:
    before = is_plain()
    plain_python(True)
    yield
    plain_python(before)


def made(function):
    return Compiler("test_plain", "exact").kernel(function)


def test_nothing_is_compiled_and_a_function_called_is_plain_too() -> None:
    compiler = Compiler("test_plain", "exact")

    @compiler.compiled
    def twice(number):
        return number + number

    def fill(row):
        for k in prange(row.size):
            row[k] = twice(row[k])

    kernel, row = compiler.kernel(fill), np.arange(3.0)
    kernel(row)
    assert row.tolist() == [0, 2, 4] and not kernel.overloads and not twice.overloads
    plain_python(False)
    assert not is_plain()
    kernel(row)
    assert row.tolist() == [0, 4, 8] and len(kernel.overloads) == 1


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_roots_and_quotients_are_those_of_the_type(real: type) -> None:
    """As IEEE 754 has them: rounded once, NaN of a negative number, an infinity for a division by zero."""

    def roots(numbers, out):
        for k in range(numbers.size):
            out[k, 0], out[k, 1] = sqrt(numbers[k]), numbers[k] / numbers[3]

    numbers = np.array([2, 1e-30, -1, 0, np.inf, np.nan, 1e-38], real)
    out = np.zeros((7, 2), real)
    made(roots)(numbers, out)
    with np.errstate(all="ignore"):
        np.testing.assert_array_equal(out, np.stack([np.sqrt(numbers), numbers / real(0)], axis=1))

    def kind(numbers, out):
        out[0] = sqrt(numbers[0]).dtype.itemsize

    made(kind)(numbers, size := np.zeros(1, np.int64))
    assert size[0] == np.dtype(real).itemsize


def test_whole_numbers_wrap_and_conversions_raise_nothing() -> None:
    def convert(numbers, out):
        out[0] = np.int64(np.int32(numbers[0]))
        out[1] = np.int64(np.uint64(2**63)) & np.int64(1)
        out[2] = np.int32(numbers[1])
        out[3] = np.int64(out[4] + np.int64(1))

    out = np.array([7, 7, 7, 7, 2**63 - 1])
    made(convert)(np.array([math.nan, -2.9]), out)
    assert out.tolist() == [-(2**31), 0, -2, -(2**63), 2**63 - 1]


def test_flags_and_rows_are_those_of_arrays() -> None:
    def move(array, flags, out):
        out[0], out[1] = row_at(array, 2)[0], row_at(array, 0).size
        store_release(flags, 1, 5)
        exchange(flags, 1, 4, 6)
        out[2] = load_acquire(flags, 1)
        exchange(flags, 0, 0, 3)

    out = np.zeros(3)
    made(move)(np.arange(4.0), flags := new_flags(2), out)
    assert out.tolist() == [2, 4, 5] and flags[:, 0].tolist() == [3, 5, 0]


def test_nobody_waits_for_another() -> None:
    """Which would be for ever, as members run one after the other: the first does every part of every phase, once."""

    def work(count, members, done):
        team = new_team(members)
        for member in prange(members):
            for phase in range(2):
                for part in assigned(team, member, count):
                    done[phase, part] += member + 1

    done = np.zeros((2, 3), np.int64)
    made(work)(3, 3, done)
    assert done.tolist() == [[1, 1, 1], [1, 1, 1]]


@pytest.mark.parametrize("inside", [False, True], ids=["arrays", "arrays in tuples"])
def test_when_its_time_is_over_the_call_is_made_again_by_machine_code(inside: bool) -> None:
    """From where it began: one band has done its part when the time is over."""

    def count(band, bands, given):
        numbers, (seen,) = given
        for k in range(numbers.size * band // bands, numbers.size * (band + 1) // bands):
            numbers[k] += 1
        seen[band] += 1

    def count_flat(band, bands, numbers, seen):
        numbers[band] += 1
        seen[band] += 1

    numbers, seen = np.zeros(4), np.zeros(4)
    kernel = Compiler("test_plain", "exact").banded(count if inside else count_flat)
    given = ((numbers, (seen,)),) if inside else (numbers, seen)

    looks = iter([False, True])  # whether the time is over

    def look() -> None:
        if next(looks):
            raise TooLong

    plain_python(True, 60.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softlab.cpu_backend.core.compile.still_time", look)
        patch.setattr("softlab.cpu_backend.core.plain._is_dispatcher", lambda _: False)  # kept from the last time, say
        kernel(4, *given)
    assert not is_plain() and kernel.overloads
    assert numbers.tolist() == [1, 1, 1, 1] and seen.tolist() == [1, 1, 1, 1]


def test_the_environment_switches_it_on() -> None:
    code = (
        "from softlab import open_simulation; from softlab.cpu_backend.core.plain import is_plain; assert is_plain()\n"
        "with open_simulation('lab-hammock', threads=1) as simulation: simulation.advance(1)\n"
        "assert not simulation._kernel.overloads"
    )
    environment = os.environ | {
        SWITCH: "1",
        SECONDS: "inf",
    }  # with a limit, machine code that another test kept would run
    subprocess.run([sys.executable, "-c", code], env=environment, check=True, timeout=120)
