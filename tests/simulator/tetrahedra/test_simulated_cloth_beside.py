"""A cloth beside tetrahedral bodies on CUDA, in plain Python: the bits of the CPU's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from beside_scenes import crumpled_state, on_cloth, tied

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene


def end_state(scene: Scene, backend: str, **options: Any) -> State:
    with open_simulation(scene, backend, initial=crumpled_state(scene), math="exact", **options) as simulation:
        simulation.advance(1)
        contacts: Any = simulation.contacts  # type: ignore[attr-defined]
        found = contacts.contact_counts if backend == "cpu" else contacts.contact_counts.copy_to_host()
        assert np.count_nonzero(found) and contacts.lost == contacts.neighbours_lost == 0
        return simulation.state()


@pytest.mark.parametrize(("precision", "kernel"), [("float32", "launch"), ("float64", "stages")])
def test_bits_are_the_cpus(precision: str, kernel: str) -> None:
    """A box falls on a cloth; another cloth hangs on one, whose foot is tied to it as well."""
    scene = on_cloth() if kernel == "launch" else tied()
    expected = end_state(scene, "cpu", precision=precision, threads=1)
    state = end_state(scene, "gpu", precision=precision, kernel=kernel)
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)
