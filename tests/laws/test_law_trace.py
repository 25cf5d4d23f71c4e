"""Saving, loading, resetting, adding and removing leave no trace; stiffness changes while position and velocity go
on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from lab import Lab, farthest, masses, same_bits, start, stirred, stirred_run
from law import of
from rows import Row
from test_law_energy import slope

from softlab.app.output.files import read_state, write_state

STEPS = 3


@of("trace")
def test_saving_loading_resetting_adding_and_removing_leave_no_trace(
    row: Row, case: str, lab: Lab, tmp_path: Path
) -> None:
    """A state holds every array that the next step reads, so that what goes on from one, also from its file, has the
    bits of what was never put aside; a reset leads to the start's bits; a body that came and went leaves the others
    theirs."""
    if case == "saved":
        begin, whole = stirred_run(lab, row, 2 * STEPS)
        half = lab.run(row.bare, STEPS, begin)
        write_state(tmp_path / "half.npz", half)
        again = lab.run(row.bare, STEPS, read_state(tmp_path / "half.npz", row.bare))
        assert same_bits(again, whole) and again.step == whole.step and again.time == whole.time
        return
    if case == "reset":
        begin = stirred(row)
        with lab.open(row.bare) as simulation:
            simulation.advance(STEPS)
            first = simulation.state()
            simulation.load(begin)
            simulation.advance(STEPS)
            simulation.reset()
            simulation.advance(STEPS)
            assert same_bits(simulation.state(), first)
        return
    begin, whole = stirred_run(lab, row, 2 * STEPS)
    scene = row.scene({row.body: {"spare": 1}})
    plain, count = start(scene), len(begin.position)
    plain.position[:count], plain.velocity[:count] = begin.position, begin.velocity
    with lab.open(scene, plain) as simulation:
        simulation.advance(STEPS)
        number = simulation.add_body(row.body, (32.0, 0.0, 0.0))
        simulation.advance(1)
        simulation.remove_body(number)
        simulation.advance(STEPS - 1)
        after = simulation.state()
    assert np.array_equal(after.position[:count], whole.position)
    assert np.array_equal(after.velocity[:count], whole.velocity)


@of("live")
def test_a_stiffness_changed_live_keeps_position_and_velocity(row: Row, case: str, lab: Lab) -> None:
    """The state after `set` has the bits from before. The step that follows moves each particle by h v and what the
    new forces make of it: |x' - x - dt v| <= dt^2 a, a the largest acceleration at its start, times 1 + (h w)^2 <= 2
    for forces that the step itself changes, and two for those of a scheme of more stages."""
    begin, path = stirred(row), "springs.stiffness" if "springs" in row.tables else "structural.stiffness"
    with lab.open(row.bare, begin, ["stiffness"]) as simulation:
        simulation.advance(STEPS)
        before = simulation.state()
        simulation.set(path, 128.0)
        after = simulation.state()
        scene = simulation.scene
        simulation.advance(1)
        last = simulation.state()
    assert same_bits(before, after)
    push = farthest(slope(scene, np.asarray(before.position, np.float64)) / masses(before))
    dt = scene.method.dt
    moved = np.asarray(last.position, np.float64) - before.position - dt * np.asarray(before.velocity, np.float64)
    assert farthest(moved) <= 4 * dt**2 * push + 100 * lab.noise(scene, last) * dt
