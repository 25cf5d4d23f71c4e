"""Time is counted from where the step size was changed last, in whatever arithmetic kernels have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from softlab.app.output.files import read_state, write_state
from softlab.model.base.clock import START, Clock, clock_of
from softlab.model.base.errors import InputError
from softlab.model.base.variant import plain_formulas
from softlab.model.contact.cloth_parameters import cloth_record
from softlab.model.contact.substep_parameters import xpbd_record
from softlab.model.core.build import build
from softlab.model.core.parameters import parameter_record
from softlab.model.core.state import State
from softlab.model.formulas import cloth, motion, wind
from softlab.model.scene.scene import load_scene

REALS = pytest.mark.parametrize("real", [np.float32, np.float64])


@REALS
@pytest.mark.parametrize("step", [0, 1, 999, 2**24 + 1, 10**12 + 3])
def test_times_stay_to_the_bit_where_the_step_size_does(real: type, step: int) -> None:
    """By the formulas as they were before there was a clock."""
    dt, offset, half = real(0.01), real(0.5), real(0.5)
    assert plain_formulas(cloth, real).instant(step, dt, real(0), real(0)) == real(step) * dt
    assert plain_formulas(motion, real).middle(step, dt, real(0), real(0)) == (real(step) + half) * dt
    assert plain_formulas(wind, real).stage_time(step, offset, dt, real(0), real(0)) == real(step) * dt + offset * dt


@REALS
@pytest.mark.parametrize("changed", [7, 2**24 + 1])
def test_kernels_read_the_time_that_the_simulation_tells(real: type, changed: int) -> None:
    """3 substeps of 2 ms after 1.25 s, to the rounding of dt, of the product and of the sum. Beyond 2^24 float32 counts
    steps by twos, so that one is rounded to the other's time: as it is without a clock."""
    scene = load_scene("cloth-small-steps").replace({"method.dt": 0.004, "method.substeps": 2})
    record = xpbd_record(scene, real, clock=Clock(changed, 1.25))
    dt, first_step, first_time = (record[0][name] for name in ("dt", "first_step", "first_time"))
    number = 2 * changed + 3
    counted = float(real(number)) - number
    told = plain_formulas(cloth, real).instant(number, dt, first_step, first_time)
    assert told == pytest.approx(1.25 + 0.006 + counted * 0.002, rel=3 * float(np.finfo(real).eps))


def test_every_record_has_the_clock() -> None:
    clock = Clock(40, 3.5)
    grid, sheet = load_scene("lab-grid"), load_scene("cloth-twist")
    for scene, make in ((grid, parameter_record), (sheet, cloth_record)):
        record = make(scene, np.float64, clock=clock)[0]
        assert (record["first_step"], record["first_time"]) == (40, 3.5)
        plain = make(scene, np.float64)[0]
        assert (plain["first_step"], plain["first_time"]) == (0, 0)


def test_which_clock_a_state_goes_on_with() -> None:
    own = Clock(10, 0.1)
    assert clock_of(own, 15, own.at(15, 0.02), 0.02) == own  # its own
    assert clock_of(START, 15, 0.15, 0.01) == START
    assert clock_of(START, 15, 0.15, 0.02) == Clock(15, 0.15)  # a state of a run with another step size
    assert clock_of(START, 0, 0.15, 0.02) == Clock(0, 0.15)
    summed = 0.0
    for _ in range(1000):
        summed += 64 * 0.01
    assert summed != 64000 * 0.01
    assert clock_of(START, 64000, summed, 0.01) == START  # summed up, not multiplied


def test_a_file_carries_the_clock(tmp_path: Path) -> None:
    scene = load_scene("lab-grid").replace({"grid.rows": 2, "grid.columns": 2})
    body = build(scene)
    state = State(body.position, body.velocity, body.inverse_mass, 0.3, 20, clock=Clock(10, 0.1))
    read = read_state(write_state(tmp_path / "state.npz", state), scene)
    assert (read.time, read.step, read.clock) == (0.3, 20, Clock(10, 0.1))
    plain = State(body.position, body.velocity, body.inverse_mass, 0.2, 20)
    assert "clock_step" not in np.load(write_state(tmp_path / "plain.npz", plain))
    for name, value in (("clock_time", np.inf), ("clock_step", -1), ("clock_step", np.zeros(2))):
        np.savez(tmp_path / "bad.npz", position=body.position, **{name: value})
        with pytest.raises(InputError, match="time"):
            read_state(tmp_path / "bad.npz", scene)
