"""What the ways of a cloth's state to the drawing cost: that both are timed on the same state, kept, and told apart. No test
depends on a time; the driver is a fake one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fake_interop import FakeRuntime, GpuCloth, Status
from test_view3d import available

from softlab.app.render import cuda_vertices
from softlab.bench.measure import vertex_timing
from softlab.bench.measure.costs_timing import RATIO, SECONDS, STAGE, Effort, Record
from softlab.bench.measure.machine import enter_machine
from softlab.bench.measure.vertex_timing import HOST, SIZES, STRAIGHT, VERTICES, vertex_groups
from softlab.bench.store.database import Store
from softlab.model.scene.scene import Scene

TINY = Effort(2, 1e-4, 1e-3)


@pytest.fixture
def faked(monkeypatch: pytest.MonkeyPatch) -> Any:
    """faked(**fails) -> the groups of one small cloth, on a GPU that is none."""
    works, text = available()
    if not works:
        pytest.skip(f"no off-screen OpenGL: {text}")

    def groups(**fails: Any) -> Any:
        runtime = FakeRuntime(**fails)

        def opened(scene: Scene, backend: str, precision: str) -> GpuCloth:
            assert backend == "gpu"
            return GpuCloth(scene, runtime, precision)

        monkeypatch.setattr(vertex_timing, "open_simulation", opened)
        monkeypatch.setattr(vertex_timing, "SIZES", (8,))
        monkeypatch.setattr(cuda_vertices, "load_runtime", lambda: runtime)
        monkeypatch.setattr(cuda_vertices, "drawn_by", lambda: ("NVIDIA Corporation", "NVIDIA H200"))
        return vertex_groups(TINY), runtime

    return groups


def test_both_ways_are_timed_in_turn_on_the_same_buffers(faked: Any) -> None:
    groups, runtime = faked()
    assert len({group.name for group in groups}) == len(groups) == 4  # two precisions, sent and drawn
    with Store(":memory:") as store:
        run = store.start_run(enter_machine(store), "test", None)
        for group in groups:
            host, straight = group.descriptions
            assert (host["way"], straight["way"], host["finding"]) == (HOST, STRAIGHT, VERTICES)
            assert {name for name in host if host[name] != straight[name]} == {"way"}
            runtime.calls.clear()
            found = group.measure(Record(store, run, group.sources))
            assert [call[0] for call in runtime.calls].count("register") == [c[0] for c in runtime.calls].count(
                "unregister"
            )
            assert not runtime.registered and len({call[1] for call in runtime.calls if call[0] == "register"}) == 2
            assert found[0][RATIO][0] == 1.0 and found[1][RATIO][0] == pytest.approx(
                np.median([a / b for a, b in zip(*samples(store, group.descriptions[::-1]), strict=True)])
            )
            assert all(numbers[SECONDS][0] > 0 for numbers in found)


def samples(store: Store, descriptions: Any) -> list[list[float]]:
    """Seconds of a frame in each sample of each description, as the store has them."""
    query = (
        "SELECT seconds / steps FROM sample JOIN configuration ON hash = configuration "
        "WHERE description = ? AND stage = ? ORDER BY repeat"
    )
    from softlab.bench.store.schema import canonical

    return [[seconds for (seconds,) in store.query(query, (canonical(d), STAGE))] for d in descriptions]


def test_a_way_that_cannot_be_had_has_its_reason(faked: Any) -> None:
    groups, _ = faked(register=(1, Status.cudaErrorUnknown))
    with Store(":memory:") as store:
        run = store.start_run(enter_machine(store), "test", None)
        host, straight = groups[0].measure(Record(store, run, groups[0].sources))
        assert host[SECONDS][0] > 0 and list(straight) == [RATIO]
        value, _, reason = straight[RATIO]
        assert value is None and "sharing a buffer failed (cudaErrorUnknown)" in reason
        assert [len(found) for found in samples(store, groups[0].descriptions)] == [TINY.repeats, 0]


def test_sizes_are_left_out_and_without_drawing_there_is_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vertex_timing, "opengl_available", lambda text: (True, "a renderer"))
    assert len(vertex_groups(TINY)) == 4 * len(SIZES)
    assert len(vertex_groups(TINY, 512)) == 4 * sum(n <= 512 for n in SIZES)
    monkeypatch.setenv("NUMBA_ENABLE_CUDASIM", "1")
    assert vertex_groups(TINY) == []
    monkeypatch.delenv("NUMBA_ENABLE_CUDASIM")
    monkeypatch.setattr(vertex_timing, "opengl_available", lambda text: (False, "no driver"))
    assert vertex_groups(TINY) == []
