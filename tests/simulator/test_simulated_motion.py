"""Pins that follow a path on the GPU's kernels, in plain Python: they go by the time, and have marks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cloth_scenes import cloth_scene

from softlab.app.driver import open_simulation
from softlab.gpu_backend.contact.pins import STILL, pin_marks
from softlab.model.base.errors import SceneError
from softlab.model.contact.cloth_parameters import P_MOTION, body_rows
from softlab.model.core.build import build
from softlab.model.scene.scene import Scene


def moving() -> Scene:
    """Pins, colliders and gusts; not the random force, which steps have by their number."""
    scene = cloth_scene("everything moving", "velocity-verlet").as_dict()
    del scene["external"]
    return Scene(scene)


@pytest.mark.parametrize("kernel", ["launch", "stages"])
def test_what_happens_depends_on_the_time_and_not_on_the_step(kernel: str) -> None:
    """To the bit: a state of 9 steps goes on as one of none or of a thousand at that time; and otherwise at another time."""
    scene, ends = moving(), []
    for step, time in ((9, 0.0047), (0, 0.0047), (1000, 0.0047), (9, 0.0051)):
        with open_simulation(scene, "gpu", math="exact", kernel=kernel, allow_unstable=True) as simulation:
            simulation.load(replace(simulation.state(), step=step, time=time))
            simulation.advance(2)
            ends.append(simulation.state())
    assert all(np.array_equal(end.position, ends[0].position) for end in ends[1:3])
    assert all(np.array_equal(end.velocity, ends[0].velocity) for end in ends[1:3])
    assert not np.array_equal(ends[3].position, ends[0].position)


def test_marks_tell_free_still_and_moving_masses_apart() -> None:
    scene = cloth_scene("moving", "lab")
    body = build(scene)
    bodies, first = body_rows(scene, body, np.float32)
    marks = pin_marks(body, bodies, first)
    assert np.count_nonzero(marks) == 3 and marks[6 * 6 + 5] == STILL
    motions = [int(bodies[int(marks[k]) + P_MOTION]) for k in (0, 3 * 6 + 2)]
    assert all(marks[k] > STILL for k in (0, 3 * 6 + 2)) and len(set(motions)) == 2 and max(motions) < first
    with pytest.raises(SceneError, match="at most 4194304 pins beside a motion in float32; use float64"):
        pin_marks(body, np.broadcast_to(np.float32(0), (2**24 + 1,)), first)
