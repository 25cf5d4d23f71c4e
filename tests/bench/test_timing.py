"""How samples are taken: same start every time, interleaved, marked where they look wrong. No test needs a time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab.app.driver import open_simulation
from softlab.bench.measure import timing
from softlab.bench.measure.machine import machine_key, machine_label, machine_record
from softlab.bench.measure.timing import (
    DISTURBED,
    DRAW_EVERY,
    Neighbours,
    Sample,
    Subject,
    choose_steps,
    interleaved,
    prepare_runs,
    warm_up,
)
from softlab.model.scene.scene import Scene

SCENE = Scene({"grid": {"rows": 6, "columns": 5, "pinned": "top"}, "springs": {}, "damping": {}, "gravity": {}})


class Recorder:
    """A renderer that keeps what it is shown."""

    def __init__(self) -> None:
        self.pictures: list[np.ndarray] = []

    def show(self, simulation: Any) -> None:
        self.pictures.append(simulation.read("position").copy())


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


def test_what_is_disturbed_is_sampled_again() -> None:
    """A second sample that is disturbed, and the next one too: B is taken twice more, A never."""
    marks = iter([None, None, None, DISTURBED, DISTURBED, None, DISTURBED])

    class Made:
        def __init__(self, name: str) -> None:
            self.name = name

        def sample(self, _: object) -> Sample:
            return Sample(1.0, 1, next(marks))

    subjects: Any = [Made("A"), Made("B")]
    taken = [(s.name, sample.suspect) for s, sample in interleaved(subjects, [2, 2], Quiet(), again=3)]
    assert taken == [("A", None), ("B", None), ("A", None), ("B", DISTURBED), ("B", DISTURBED), ("B", None)]


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
        def cores(self) -> float:
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


class Watched(Neighbours):
    """Reads a made-up system: the moments that `_now` tells, one after the other."""

    def __init__(self, *moments: tuple[float, float, float]) -> None:
        self.moments = list(moments)
        super().__init__()

    def _now(self) -> tuple[float, float, float]:  # type: ignore[override]
        return self.moments.pop(0)


START = (100.0, 50.0, 20.0)  # clock, core seconds of all programs, those of this one


@pytest.mark.parametrize(
    ("later", "others"),
    [
        ((101.0, 51.0, 21.0), 0.0),  # all that was used was this program's own
        ((101.0, 52.0, 21.0), 1.0),
        ((102.0, 53.0, 22.0), 0.5),  # half of the time
        ((101.0, 50.5, 21.0), 0.0),  # the system counts in hundredths: never less than none
    ],
)
def test_what_others_use_is_what_all_use_but_for_this_program(later: tuple[float, ...], others: float) -> None:
    assert Watched(START, later).cores() == pytest.approx(others)  # type: ignore[arg-type]


def test_a_look_too_soon_keeps_what_the_last_one_said() -> None:
    watch = Watched(START, (101.0, 52.0, 21.0), (101.0 + 0.9 * timing.WATCH_SECONDS, 99.0, 21.0))
    assert watch.cores() == watch.cores() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("threads", "cores", "busy", "disturbed"),
    [(2, 2, 0.24, False), (2, 2, 0.26, True), (1, 2, 1.24, False), (1, 2, 1.26, True), (8, 2, 0.26, True)],
)
def test_a_busy_neighbour_is_noticed_once_it_takes_a_quarter_of_a_core_in_use(
    threads: int, cores: int, busy: float, disturbed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(timing, "core_count", lambda: cores)
    found = Watched(START, (101.0, 51.0 + busy, 21.0)).suspicion(threads)
    assert found == ("load: other programs ran on the cores in use" if disturbed else None)


def test_this_systems_counters_grow() -> None:
    """Of the real one: a clock that runs, and no less of the cores used than a moment ago."""
    first, second = Neighbours._now(), Neighbours._now()
    assert second[0] >= first[0] and second[2] >= first[2]
    assert second[1] >= first[1] > 0


class Late:
    """A device on which steps take no time to ask for and 10 ms each until they are waited for."""

    backend, threads, snapshots, step, kernel = "gpu", 1, -2, 0, "graph"
    real = np.float64

    def __init__(self, clock: list[float]) -> None:
        self.clock, self.asked = clock, 0
        self.body = type("Body", (), {"position": np.zeros((3, 2))})()

    def advance(self, steps: int) -> None:
        self.asked += steps

    def synchronize(self) -> None:
        self.clock[0] += 0.01 * self.asked
        self.asked = 0

    def read(self, name: str) -> np.ndarray:
        self.synchronize()
        return self.body.position

    def reset(self) -> None:
        self.asked += 7  # restoring takes its time, too, before the sample

    rewind = reset

    def check(self, snapshot: bool) -> None:
        self.asked += 5  # and looking at the state after it


class Elsewhere:
    """Draws where the device computes: what it shows is not waited for by the host."""

    def show(self, simulation: Any) -> None:
        assert simulation.asked


@pytest.mark.parametrize("renderer", [None, Recorder(), Elsewhere()], ids=["none", "by the host", "by the device"])
def test_a_sample_waits_for_the_device_and_holds_nothing_but_its_steps(
    renderer: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    monkeypatch.setattr(timing.time, "perf_counter", lambda: clock[0])
    subject = Subject(Late(clock), renderer=renderer, steps=20)  # type: ignore[arg-type]
    assert subject.run(20) == pytest.approx(0.2)
    assert subject.sample(Quiet()) == Sample(pytest.approx(0.2), 20, None)


def test_a_sample_far_too_short_is_taken_again_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """20 steps of 10 ms where a second is wanted: five times as many, and then it is long enough."""
    clock = [0.0]
    monkeypatch.setattr(timing.time, "perf_counter", lambda: clock[0])
    subject = Subject(Late(clock), steps=20, wanted_seconds=1.0)  # type: ignore[arg-type]
    assert subject.sample(Quiet()) == Sample(pytest.approx(1.0), 100, None)


def test_a_sample_is_whole_runs_from_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 20 steps of 10 ms each, where a second is wanted: five runs. Rewinding costs 7 steps each, outside the clock."""
    clock, rewound = [0.0], []
    monkeypatch.setattr(timing.time, "perf_counter", lambda: clock[0])
    device = Late(clock)
    monkeypatch.setattr(device, "rewind", lambda: (rewound.append(device.asked), device.reset())[0], raising=False)
    subject = prepare_runs(Subject(device), 20, 1.0)  # type: ignore[arg-type]
    assert (subject.steps, subject.run_steps) == (100, 20)
    rewound.clear()
    assert subject.sample(Quiet()) == Sample(pytest.approx(1.0), 100, None)
    assert len(rewound) == 5 and not any(rewound)


@pytest.mark.parametrize("dt", [0.02, 0.005])
def test_a_whole_run_ends_at_the_time_of_the_error(dt: float) -> None:
    with opened(math="exact") as simulation:
        steps = round(0.1 / dt)
        subject = prepare_runs(Subject(simulation), steps, 1e-3)
        assert subject.steps % steps == 0
        subject.sample(Quiet())
        assert simulation.step == steps


def test_the_machine_is_named_by_its_hardware_and_versions() -> None:
    record = machine_record()
    assert machine_key(record) == machine_key(machine_record())
    assert machine_key(record) == machine_key(record | {"copy_bandwidth": 1.0, "wait_policy": "passive"})
    assert machine_key(record) != machine_key(record | {"cores": record["cores"] + 1})
    label = machine_label({"cpu": "AMD EPYC(TM) 7B12 64-Core Processor", "cores": 2, "gpu": None})
    assert label == "AMD EPYC 7B12, 2 cores; no GPU"
    assert machine_label({"cpu": "X", "cores": 1, "gpu": "H200", "gpu_count": 2}) == "X, 1 core; 2 x H200"
