"""Threads that work together: teams (cpu_backend/core/progress.py), how idle threads wait, and what `--threads auto` takes.

Nothing here depends on how long anything takes.
"""

import threading
from types import SimpleNamespace

import numba
import numpy as np
import pytest

from softlab.app import driver
from softlab.app.auto_threads import AUTO, decide, open_quickest, step_seconds
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import assigned, new_team
from softlab.cpu_backend.core.threads import BRIEF, POLICY, SPIN_COUNT, policy_of, wait_briefly
from softlab.model.base.errors import Diverged

PARTS, PHASES = 4, 200


@numba.njit(nogil=True)
def work(team, member, parts, phases, states, times, who):
    """Every part sums its neighbours of the phase before; every fifth phase has one part, which mixes all of them."""
    for phase in range(phases):
        old, new = states[phase % 2], states[(phase + 1) % 2]
        if phase % 5 == 4:
            for part in assigned(team, member, 1):
                times[phase, part] += 1
                who[phase, part] = member
                for k in range(parts):
                    new[k] = (3 * old[k] + old[parts - 1 - k]) % 1000003
        else:
            for part in assigned(team, member, parts):
                times[phase, part] += 1
                who[phase, part] = member
                new[part] = (old[part] + 7 * old[(part + 1) % parts] + 11 * old[part - 1] + phase) % 1000003


def expected():
    state = np.arange(1, PARTS + 1, dtype=np.int64)
    for phase in range(PHASES):
        if phase % 5 == 4:
            state = (3 * state + state[::-1]) % 1000003
        else:
            state = (state + 7 * np.roll(state, -1) + 11 * np.roll(state, 1) + phase) % 1000003
    return state


def room():
    states = np.zeros((2, PARTS), np.int64)
    states[0] = np.arange(1, PARTS + 1)
    return states, np.zeros((PHASES, PARTS), np.int64), np.full((PHASES, PARTS), -1, np.int64)


def check(states, times):
    once = np.ones((PHASES, PARTS), np.int64)
    once[4::5, 1:] = 0
    assert np.array_equal(times, once)  # every part of every phase, by one member
    assert np.array_equal(states[PHASES % 2], expected())  # and only when the phase before was done


def run_members(order):
    """Each member on a Python thread of its own, those of one tuple at the same time, the tuples one after the other."""
    team, (states, times, who) = new_team(PARTS), room()
    for together in order:
        threads = [
            threading.Thread(target=work, args=(team, member, PARTS, PHASES, states, times, who)) for member in together
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    check(states, times)
    return who


def test_members_that_run_together_do_every_part_once_and_in_order():
    """Four members, more than this machine may have cores."""
    for _ in range(5):
        run_members([(0, 1, 2, 3)])


@pytest.mark.parametrize("first", range(PARTS))
def test_members_that_never_meet_leave_the_work_to_the_first(first):
    """As on a threading layer that runs one after the other: nobody hangs, and the first does it all."""
    others = [(m,) for m in range(PARTS) if m != first]
    who = run_members([(first,), *others])
    assert set(who[who >= 0]) == {first}


def test_members_that_come_late_join():
    run_members([(2, 3), (0, 1)])


def test_a_team_kernel_is_one_region_of_any_number_of_threads():
    """More bands than threads, too: OpenMP then runs some members after others."""

    def double(team, member, bands, passes, numbers):
        for _ in range(passes):
            for band in assigned(team, member, bands):
                for k in range(numbers.size * band // bands, numbers.size * (band + 1) // bands):
                    numbers[k] *= 2

    kernel = Compiler("test_teams", "exact").team(double)
    most = numba.config.NUMBA_NUM_THREADS
    for threads in {1, 2, most}:
        numba.set_num_threads(min(threads, most))
        for bands in (1, 2, 3, 8):
            numbers = np.arange(100, dtype=np.int64)
            kernel(bands, 5, numbers)
            assert np.array_equal(numbers, 32 * np.arange(100))
    numba.set_num_threads(most)


# ---------------------------------------------------------------------- how idle threads wait


@pytest.mark.parametrize(
    ("given", "left", "policy"),
    [
        ({}, BRIEF, "brief"),
        ({"HOME": "/"}, {"HOME": "/"} | BRIEF, "brief"),
        ({POLICY: "PASSIVE"}, {POLICY: "PASSIVE"}, "passive"),
        ({POLICY: "active"}, {POLICY: "active"}, "active"),
        ({SPIN_COUNT: "17"}, {SPIN_COUNT: "17"}, "custom"),
        ({POLICY: "active", SPIN_COUNT: "17"}, {POLICY: "active", SPIN_COUNT: "17"}, "active"),
        (BRIEF, BRIEF, "brief"),  # a process that one of ours started
        (BRIEF | {POLICY: "active"}, {POLICY: "active"}, "active"),  # and told otherwise
    ],
)
def test_the_lab_says_how_threads_wait_unless_the_user_does(given, left, policy):
    environment = dict(given)
    wait_briefly(environment)
    assert environment == left
    assert policy_of(environment) == policy


def test_without_a_word_from_anyone_the_runtime_has_its_own_way():
    assert policy_of({}) == "default"


# ---------------------------------------------------------------------- --threads auto


@pytest.mark.parametrize(
    ("seconds", "chosen"),
    [
        ({2: 0.005, 1: 0.009}, 2),
        ({2: 0.2, 1: 0.009}, 1),
        ({2: 0.0095, 1: 0.01}, 1),  # not worth a core
        ({16: 0.001, 1: 0.0111}, 16),
    ],
)
def test_auto_takes_more_threads_only_where_they_gain(seconds, chosen):
    threads, why = decide(seconds)
    assert threads == chosen
    assert why.startswith("auto: ") and all(f"on {count}" in why for count in seconds)


class Fake:
    """A simulation whose step takes `taken` s of a clock that all of them share."""

    def __init__(self, threads, clock, taken, diverges=False):
        self.threads, self.clock, self.taken, self.diverges = threads, clock, taken, diverges
        self.closed, self.steps, self.threads_reason = False, 0, None

    def advance(self, steps):
        if self.diverges:
            raise Diverged(1, 0, 0.1, 0.01)
        self.steps += steps
        self.clock[0] += steps * self.taken

    def synchronize(self):
        pass

    def reset(self):
        self.steps = 0

    def close(self):
        self.closed = True


def test_steps_are_timed_in_turn_from_the_start():
    clock = [0.0]
    fakes = [Fake(2, clock, 0.25), Fake(1, clock, 0.125)]
    assert step_seconds(fakes, lambda: clock[0]) == [0.25, 0.125]


@pytest.mark.parametrize(("seconds", "kept"), [([0.25, 0.125], 1), ([0.125, 0.25], 4)])
def test_auto_keeps_one_simulation_at_its_start_and_closes_the_other(seconds, kept):
    opened = []

    def open_with(count):
        opened.append(Fake(count, [0.0], 0.1))
        return opened[-1]

    def measure(simulations):
        for simulation in simulations:
            simulation.advance(3)
        return seconds

    chosen = open_quickest(open_with, 4, measure)
    assert chosen.threads == kept and chosen.steps == 0 and not chosen.closed
    assert "125 ms a step" in chosen.threads_reason
    assert [fake.closed for fake in opened] == [fake is not chosen for fake in opened]


def test_auto_of_one_core_and_of_a_scene_that_diverges():
    alone = open_quickest(lambda count: Fake(count, [0.0], 0.1), 1)
    assert alone.threads == 1 and "one core" in alone.threads_reason
    broken = open_quickest(lambda count: Fake(count, [0.0], 0.1, diverges=True), 2)
    assert broken.threads == 2 and "diverged" in broken.threads_reason


def test_auto_closes_what_it_opened_when_it_is_interrupted():
    opened = []

    def open_with(count):
        opened.append(Fake(count, [0.0], 0.1))
        return opened[-1]

    def interrupted(simulations):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        open_quickest(open_with, 2, interrupted)
    assert len(opened) == 2 and all(fake.closed for fake in opened)


def test_auto_goes_through_the_door(monkeypatch):
    asked = []

    def opened(scene, backend, options, threads):
        asked.append(threads)
        return SimpleNamespace(scene=scene, threads=threads, faults=dict)

    monkeypatch.setattr(driver, "_open", opened)
    monkeypatch.setattr(driver, "open_quickest", lambda open_with, most: open_with(most))
    from softlab.cpu_backend.core.threads import core_count

    assert driver.open_simulation("lab-grid", threads=AUTO).threads == core_count()
    assert driver.open_simulation("lab-grid", threads="2x").threads == "2x"
    assert driver.open_simulation("lab-grid", backend="gpu", threads=AUTO).threads == AUTO  # which has no use for it
    assert asked == [core_count(), "2x", AUTO]
