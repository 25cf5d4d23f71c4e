"""How samples are taken: same start every time, interleaved, marked where they look wrong. No test needs a time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.driver import open_simulation
from bench import timing
from bench.machine import machine_key, machine_label, machine_record
from bench.timing import DRAW_EVERY, Neighbours, Sample, Subject, choose_steps, interleaved, time_simulations, warm_up
from model.scene import Scene

SCENE = Scene({"grid": {"rows": 6, "columns": 5, "pinned": "top"}, "springs": {}, "damping": {}, "gravity": {}})


class Recorder:
    """A renderer that keeps what it is shown."""

    def __init__(self) -> None:
        self.pictures: list[np.ndarray] = []

    def draw(self, position: np.ndarray) -> None:
        self.pictures.append(position.copy())


class Quiet(Neighbours):
    def suspicion(self, threads: int) -> str | None:
        return None


def opened(**options: Any) -> Any:
    return open_simulation(SCENE, "cpu", threads=1, **options)


def test_every_repeat_starts_from_the_same_state_and_does_the_same_steps() -> None:
    with opened(math="exact") as simulation:
        simulation.advance(7)
        start = simulation.state()
        simulation.advance(20)
        expected = simulation.read("position")
        subject = Subject(simulation, start=start, steps=20)
        for _ in range(3):
            assert subject.sample(Quiet()).steps == 20
            assert simulation.step == start.step + 20
            np.testing.assert_array_equal(simulation.read("position"), expected)


def test_samples_are_interleaved_and_handed_out_at_once() -> None:
    with opened() as one, opened(precision="float64") as two:
        subjects = [Subject(one, "A", steps=1), Subject(two, "B", steps=1)]
        assert [s.name for s, _ in interleaved(subjects, [3, 2], Quiet())] == list("ABABA")
        first = next(interleaved(subjects, [3, 3], Quiet()))
        assert first[0].name == "A" and two.step <= 1


def test_time_simulations_gives_raw_repeats_for_each() -> None:
    heard: list[tuple[int, Sample]] = []
    with opened() as one, opened(precision="float64") as two:
        samples = time_simulations([one, two], 3, 1e-4, on_sample=lambda k, sample: heard.append((k, sample)))
    assert [len(of_one) for of_one in samples] == [3, 3]
    assert [k for k, _ in heard] == [0, 1] * 3
    assert all(sample.seconds > 0 and sample.steps >= 1 for of_one in samples for sample in of_one)


def test_graphics_draws_every_tenth_step_inside_the_sample() -> None:
    renderer = Recorder()
    with opened(math="exact") as simulation:
        subject = Subject(simulation, renderer=renderer, steps=3 * DRAW_EVERY)
        subject.sample(Quiet())
        assert len(renderer.pictures) == 3
        simulation.reset()
        simulation.advance(DRAW_EVERY)
        np.testing.assert_array_equal(renderer.pictures[0], simulation.read("position"))
        warm_up(subject)
        assert choose_steps(subject, 0.0, 1.0) % DRAW_EVERY == 0


@settings(deadline=None)
@given(st.floats(0, 1e9))
def test_steps_are_whole_and_never_fewer_than_wanted(wanted: float) -> None:
    steps = timing._two_digits(wanted)
    assert wanted <= steps <= max(1.1 * wanted, wanted + 1)


def test_a_sample_that_cannot_be_trusted_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    class Loud(Neighbours):
        def cores(self, threads: int) -> float:
            return 99.0

    with opened() as simulation:
        subject = Subject(simulation, steps=1)
        monkeypatch.setattr(timing, "SHORTEST_SAMPLE", float("inf"))
        suspect = subject.sample(Loud()).suspect
        assert suspect is not None and "under 1 ms" in suspect and "load" in suspect
        monkeypatch.setattr(timing, "SHORTEST_SAMPLE", 0.0)
        assert subject.sample(Quiet()).suspect is None


def test_a_state_that_breaks_is_marked_not_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "SHORTEST_SAMPLE", 0.0)
    scene = SCENE.replace({"method.dt": 1.0, "perturbation.amplitude": 0.1})
    with open_simulation(scene, "cpu", threads=1, allow_unstable=True) as simulation:
        sample = Subject(simulation, steps=600).sample(Quiet())
    assert sample.suspect is not None and "not finite" in sample.suspect and sample.steps == 600


def test_the_neighbours_are_watched_without_harm() -> None:
    watch = Neighbours()
    assert watch.cores(1) >= 0.0
    assert watch.suspicion(1) is None or isinstance(watch.suspicion(1), str)


def test_the_machine_is_named_by_its_hardware_and_versions() -> None:
    record = machine_record()
    assert machine_key(record) == machine_key(machine_record())
    assert machine_key(record) == machine_key(record | {"copy_bandwidth": 1.0, "wait_policy": "passive"})
    assert machine_key(record) != machine_key(record | {"cores": record["cores"] + 1})
    label = machine_label({"cpu": "AMD EPYC(TM) 7B12 64-Core Processor", "cores": 2, "gpu": None})
    assert label == "AMD EPYC 7B12, 2 cores; no GPU"
    assert machine_label({"cpu": "X", "cores": 1, "gpu": "H200", "gpu_count": 2}) == "X, 1 core; 2 x H200"
