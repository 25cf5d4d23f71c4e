"""Flushing of subnormals: in every worker in `fast` math, never in `exact`, and the register is restored on the way out."""

import numba
import numpy as np
import pytest

from softlab.app.command.doctor import examine
from softlab.cpu_backend.core import subnormals
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.subnormals import FLUSH, control_register, flushes

THREADS = min(2, numba.config.NUMBA_NUM_THREADS)
SMALL = {np.float32: 2.0**-126, np.float64: 2.0**-1022}  # smallest normal number
supported = pytest.mark.skipif(not FLUSH, reason=f"subnormals are not flushed on {subnormals.MACHINE}")


@numba.njit
def here():
    return control_register()


@numba.njit
def registers(bands):
    """Return the registers of the worker threads, by band."""
    found = np.zeros(bands, np.int64)
    for band in numba.prange(bands):
        found[band] = control_register()
    return found


def halved(math, real, kind):
    """Run a kernel that halves the smallest normal numbers; return the registers that it saw and its results."""

    def band(band, bands, seen, numbers, results):
        seen[band] = control_register()
        results[band] = numbers[band] * numbers.dtype.type(0.5)

    def member(team, member, bands, seen, numbers, results):
        for part in assigned(team, member, bands):
            seen[part] = control_register()
            results[part] = numbers[part] * numbers.dtype.type(0.5)

    compiler = Compiler(f"halved_{np.dtype(real).name}_{math}", math)
    kernel = compiler.banded(band) if kind == "banded" else compiler.team(member)
    numba.set_num_threads(THREADS)
    seen, numbers = np.zeros(THREADS, np.int64), np.full(THREADS, SMALL[real], real)
    results = np.ones(THREADS, real)
    kernel(THREADS, seen, numbers, results)
    return seen, results


@supported
@pytest.mark.parametrize("kind", ["banded", "team"])
@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_every_worker_flushes_in_fast_math_only(real, kind):
    before = here()
    seen, results = halved("fast", real, kind)
    assert np.all(seen & FLUSH == FLUSH)
    assert np.all(results == 0)
    seen, results = halved("exact", real, kind)
    assert not np.any(seen & FLUSH)
    assert np.all(results == real(SMALL[real]) / 2)
    assert (here() & FLUSH) == (before & FLUSH) == 0


@supported
def test_the_registers_of_all_threads_are_restored():
    halved("fast", np.float32, "banded")
    assert not flushes()
    parallel = numba.njit(parallel=True)(registers.py_func)
    assert not np.any(parallel(THREADS) & FLUSH)
    assert np.float32(SMALL[np.float32]) * np.float32(0.5) > 0  # also for NumPy


@supported
def test_the_register_is_restored_after_an_exception():
    def fails(band, bands, numbers):
        if numbers[band] * numbers.dtype.type(0.5) == 0:
            raise ValueError("flushed")

    kernel = Compiler("fails", "fast").banded(fails)
    kernel(1, np.full(1, SMALL[np.float32], np.float32))  # the body's error ends the body
    assert not flushes()
    with pytest.raises(numba.TypingError):
        kernel(1, "no array")
    assert not flushes()


@supported
def test_a_register_that_was_set_before_stays_set():
    @numba.njit
    def set_bits(value):
        write(value)

    before = here()
    set_bits(before | FLUSH)
    try:
        halved("fast", np.float32, "banded")
        assert flushes()
    finally:
        set_bits(before)
    assert not flushes()


@numba.extending.intrinsic
def write(typing_context, value):
    def build(context, builder, signature, arguments):
        subnormals.write_register(builder, arguments[0])
        return context.get_dummy_value()

    return numba.types.void(numba.types.int64), build


def test_other_architectures_are_left_alone_and_the_doctor_says_so(monkeypatch):
    monkeypatch.setattr(subnormals, "FLUSH", 0)
    monkeypatch.setattr("softlab.cpu_backend.core.region.FLUSH", 0)
    monkeypatch.setattr(subnormals, "MACHINE", "riscv64")

    def plain(band, bands, numbers):
        numbers[band] *= numbers.dtype.type(0.5)

    numbers = np.full(1, SMALL[np.float32], np.float32)
    Compiler("plain", "fast").banded(plain)(1, numbers)
    assert numbers[0] > 0
    (cpu,) = (finding for finding in examine() if finding.name == "cpu threads")
    assert "does not flush subnormals on riscv64" in cpu.detail
