"""The CUDA kernels of lattices in plain Python: the same bits however many windows a thread takes."""

from __future__ import annotations

import pytest
from bodies_scenes import blocks, end_state, same


def test_windows_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """How many windows a thread goes through changes no bit: one each, two, all of a group."""
    import softlab.gpu_backend.shape_matching.lattice as lattice

    scene, found = blocks(1, 1, (2, 6, 7), 1), []
    for busy in (2**17, 40, 1):
        monkeypatch.setattr(lattice, "BUSY", busy)
        found.append(end_state(scene, "gpu", precision="float32", steps=1, kernel="launch"))
    assert same(found[0], found[1]) and same(found[0], found[2])
