"""Workers that are killed, refused, stopped or left alone: nothing is lost and nothing measured twice."""

from __future__ import annotations

import json
import os
import random
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from fake_cluster import BEAT, REPEATS, ForkPool, fork_server, logged, run_fake, sampled

from softlab.bench.cluster import sweep
from softlab.bench.cluster.folder import Folder
from softlab.bench.cluster.pools import Where
from softlab.bench.cluster.start import FOLDER, on_cluster
from softlab.bench.cluster.summary import ClusterSummary
from softlab.bench.store.database import Store
from softlab.model.base.errors import BackendUnavailable, InputError

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="workers are forked here")

GROUPS = [[2 * k + 2, 2 * k + 3] for k in range(8)]  # of sizes


class Bench:
    """A store, a folder of what workers told, and sweeps on forked workers."""

    def __init__(self, folder: Path):
        self.path, self.log = folder / "results.sqlite", folder / "log"
        self.log.mkdir()

    def run(
        self, slots: int = 2, groups: Any = None, pool: ForkPool | None = None, timed: bool = False, **how: Any
    ) -> ClusterSummary:
        made = pool or ForkPool(slots)
        with Store(self.path) as store:
            return on_cluster(
                store, run_fake, Where("local"), timed=timed, command="fake", progress=False, beat=BEAT,
                pool=lambda folder: made,
                how={"groups": GROUPS if groups is None else groups, "log": str(self.log)} | how,
            )  # fmt: skip

    def samples(self) -> list[tuple[str, str, float]]:
        with Store(self.path, readonly=True) as store:
            return sampled(store)

    def check_complete(self, machines: int = 1, sizes: int = 2 * len(GROUPS)) -> None:
        """Every configuration has its samples and none more, on each machine; none that a worker finished is lost."""
        counts = Counter((machine, key) for machine, key, _ in self.samples())
        assert len(counts) == machines * sizes and set(counts.values()) == {REPEATS}
        assert {seconds for (seconds,) in logged(self.log, "sample")} <= {seconds for *_, seconds in self.samples()}
        assert not self.path.with_suffix(FOLDER).exists(), "all is in the store: the workers' folder is gone"


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield Bench(tmp_path)
    for number, handler in handlers.items():
        signal.signal(number, handler)


def meanwhile(bench: Bench, act: Callable[[Folder], bool]) -> threading.Thread:
    """A thread that shows the folder of the sweep under way to `act` until that is true, or for a minute."""

    def watch() -> None:
        give_up = time.monotonic() + 60
        while time.monotonic() < give_up:
            time.sleep(0.01)
            for path in bench.path.with_suffix(FOLDER).glob("*/status"):
                try:
                    if act(Folder(path.parent)):
                        return
                except (OSError, InputError):  # it has just been cleared away
                    continue

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    return thread


def test_workers_share_the_groups_and_a_second_sweep_measures_nothing(bench: Bench) -> None:
    summary = bench.run(slots=3)
    bench.check_complete()
    assert summary.samples == REPEATS * 2 * len(GROUPS) and summary.measured == 2 * len(GROUPS)
    assert len(logged(bench.log, "group")) == len(GROUPS), "each group was one worker's"
    assert summary.machines == ["m0"] and not summary.losses and not summary.abandoned
    again = bench.run()
    assert (again.samples, again.measured, again.stored) == (0, 0, 2 * len(GROUPS))
    bench.check_complete()


def test_more_groups_are_measured_beside_those_that_the_store_holds(bench: Bench) -> None:
    bench.run(groups=GROUPS[:3])
    summary = bench.run()
    assert summary.measured == 2 * (len(GROUPS) - 3) and summary.stored == 6
    bench.check_complete()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_workers_killed_at_random_lose_nothing_and_repeat_nothing(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    monkeypatch.setattr(sweep, "DEATHS", 1000)
    chance, killed = random.Random(seed), list[int]()

    def kill(folder: Folder) -> bool:
        told = [folder.status(name) for name in folder.workers()]
        running = [status.pid for status in told if status and status.holding and status.pid not in killed]
        if running:
            time.sleep(chance.uniform(0, 0.15))  # a group takes 0.18 s and more
            killed.append(chance.choice(running))
            os.kill(killed[-1], signal.SIGKILL)
        return len(killed) >= 8

    killer = meanwhile(bench, kill)
    summary = bench.run(slots=3, seconds=0.03)
    killer.join()
    bench.check_complete()
    assert summary.losses and all("killed by signal 9" in loss for loss in summary.losses)


def test_of_workers_that_reach_for_a_group_at_once_one_has_it(tmp_path: Path) -> None:
    folder, claims = Folder(tmp_path / "one", make=True), [f"m.1.{k}" for k in range(40)]
    names = [f"{k}.1" for k in range(8)]
    began = threading.Barrier(len(names))
    had: dict[str, list[str]] = {}

    def reach(name: str) -> None:
        began.wait()
        had[name] = [claim for claim in claims if folder.claim(claim, name)]

    threads = [threading.Thread(target=reach, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(claim for mine in had.values() for claim in mine) == sorted(claims)
    assert folder.claims() == {claim: name for name, mine in had.items() for claim in mine}


def test_what_kills_its_workers_is_given_up_and_the_rest_is_measured(bench: Bench) -> None:
    summary = bench.run(poison=GROUPS[3][1:])
    assert len(summary.losses) == sweep.DEATHS
    (told,) = summary.abandoned
    assert str(GROUPS[3][0]) in told and "died 3 times" in told and "killed by signal 9" in told
    held = Counter(key for _, key, _ in bench.samples())
    assert len(held) == 2 * len(GROUPS) - 1 and set(held.values()) == {REPEATS}, "what it measured before is kept, once"
    assert bench.run().measured == 1, "the same command, when it kills no more, measures what is left"
    bench.check_complete()


def test_workers_that_cannot_begin_are_given_up_with_the_reason(bench: Bench) -> None:
    pool = ForkPool(2, "ends_with_seven")
    with pytest.raises(BackendUnavailable, match=r"ended with exit status 7.*logs"):
        bench.run(pool=pool)
    assert len(pool.jobs) == 2 * sweep.DEATHS
    assert not bench.path.exists(), "nothing was measured"


def test_what_workers_refuse_is_told_as_it_is_and_not_tried_again(bench: Bench) -> None:
    pool = ForkPool(2)
    with pytest.raises(InputError, match="must be something else") as refusal:
        bench.run(pool=pool, refuse="must be something else")
    assert refusal.value.exit_status == 2 and len(pool.jobs) == 2
    assert not bench.path.with_suffix(FOLDER).exists()


def test_ctrl_c_leaves_what_is_finished_and_the_same_command_resumes(bench: Bench) -> None:
    def interrupt(folder: Folder) -> bool:
        if len(logged(bench.log, "sample")) < 5:
            return False
        os.kill(os.getpid(), signal.SIGINT)
        return True

    signal.signal(signal.SIGINT, signal.default_int_handler)
    thread = meanwhile(bench, interrupt)
    summary = bench.run(seconds=0.05)
    thread.join()
    assert summary.interrupted and 5 <= summary.samples < REPEATS * 2 * len(GROUPS) and not summary.losses
    assert {seconds for (seconds,) in logged(bench.log, "sample")} <= {seconds for *_, seconds in bench.samples()}
    assert not bench.run().interrupted
    bench.check_complete()


def test_a_sweep_that_is_killed_itself_is_gone_on_with(bench: Bench) -> None:
    pid = fork_server().fork("sweeps", str(bench.path), json.dumps([GROUPS, str(bench.log), 0.1]))
    while len(logged(bench.log, "sample")) < 5:
        time.sleep(0.01)
    os.kill(pid, signal.SIGKILL)
    while fork_server().poll(pid) is None:
        time.sleep(0.01)
    assert bench.path.with_suffix(FOLDER).exists(), "workers' stores are there still"
    bench.run()
    bench.check_complete()


def test_two_sweeps_at_one_store_are_refused(bench: Bench) -> None:
    refused: list[str] = []

    def second(folder: Folder) -> bool:
        try:
            bench.run()
        except InputError as error:
            refused.append(str(error))
        return True

    thread = meanwhile(bench, second)
    bench.run(seconds=0.05)
    thread.join()
    assert "another sweep" in refused[0]
    bench.check_complete()


def test_who_times_has_the_machine_to_itself(bench: Bench) -> None:
    bench.run(slots=2, timed=True, backends=["cpu"], groups=GROUPS[:5])
    spans = sorted(logged(bench.log, "group"))
    assert len(spans) == 5
    assert all(end <= begin for (_, end), (begin, _) in pairwise(spans)), "two at a time"


def test_machines_that_differ_measure_everything_each_and_are_never_one_curve(bench: Bench) -> None:
    from softlab.bench.store.results import timings
    from softlab.plots.core.read import load

    summary = bench.run(slots=2, kinds=2, seconds=0.02)
    bench.check_complete(machines=2)
    assert sorted(summary.machines) == ["m0", "m1"]
    with Store(bench.path, readonly=True) as store:
        told = timings(store)
        assert all(t.count == REPEATS for t in told), "no timing has samples of both"
        sources = load(store).sources
    assert {source.machine.key for source in sources} == {"m0", "m1"}
    for source in sources:
        assert {timing.machine for timing in source.timings} == {source.machine.key}


def test_a_machine_whose_only_worker_is_gone_is_told_of(bench: Bench) -> None:
    """Its groups stay, and no other kind of machine takes them."""
    summary = bench.run(slots=1, moves_at=GROUPS[2][0])
    assert sorted(summary.machines) == ["m0", "m1"] and len(summary.losses) == 1
    assert any("no such machine" in told for told in summary.abandoned)
    assert any(f"{len(GROUPS) - 2} groups were not taken by any worker" in told for told in summary.abandoned)
    counts = Counter(machine for machine, *_ in bench.samples())
    assert counts == {"m0": REPEATS * 2 * len(GROUPS), "m1": REPEATS * 2 * 2}


def test_a_worker_that_does_not_stop_is_ended_by_force(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep, "STOP_SECONDS", 0.1)

    def interrupt(folder: Folder) -> bool:
        if len(pool.jobs) < 2 or not (folder.path / "asleep").exists():
            return False
        os.kill(os.getpid(), signal.SIGINT)
        return True

    signal.signal(signal.SIGINT, signal.default_int_handler)
    pool = ForkPool(2, "sleeps")
    thread = meanwhile(bench, interrupt)
    assert bench.run(pool=pool).interrupted
    thread.join()
    assert [job.how for job in pool.jobs] == 2 * ["killed by signal 9"]


def test_jobs_that_still_wait_when_all_is_done_are_let_go(bench: Bench) -> None:
    pool = ForkPool(2, "sleeps_but_the_first", queues=True)
    summary = bench.run(pool=pool)
    assert len(pool.jobs) == 2 and not summary.losses and not summary.abandoned
    bench.check_complete()


def test_what_cannot_be_merged_is_kept_and_told(bench: Bench) -> None:
    old = bench.path.with_suffix(FOLDER) / "old"
    folder = Folder(old, make=True)
    folder.store_of("1.1").write_text("this was a store once")
    summary = bench.run()
    assert summary.measured == 2 * len(GROUPS)
    (told,) = summary.unmerged
    assert "neither a store" in told and folder.store_of("1.1").exists()
