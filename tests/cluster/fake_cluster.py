"""An experiment of milliseconds for workers to measure, and a pool that forks them, so that none has to import anything."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from bench.cluster.pools import exit_words
from bench.cluster.worker import main
from bench.measure.experiment import Summary, Tell, resume
from bench.store.database import Store
from bench.store.results import configuration
from model.core.errors import SceneError
from model.scene.scene import load_scene

SOURCES, REPEATS = "s", 3
RECORD = {"cpu": "Some CPU", "cores": 2, "gpu_count": None}


@cache
def description(size: int) -> dict[str, Any]:
    scene = load_scene("lab-grid").replace({"grid.rows": size, "grid.columns": size})
    return configuration(scene, backend="cpu", threads=2, layer="omp", wait_policy="passive")


def run_fake(
    store: Store,
    *,
    groups: Sequence[Sequence[int]],
    log: str,
    seconds: float = 0.002,
    kinds: int = 1,
    poison: Sequence[int] = (),
    refuse: str = "",
    moves_at: int | None = None,
    dies_once: int | None = None,
    progress: bool = False,
    command: str = "fake",
    backends: Any = None,
) -> Summary:
    """Take REPEATS samples of each size, each told in a file of this process in `log` once it is in the store; the file also
    tells when each group began and ended. `kinds` of machine, by the worker's number; `poison`: sizes that kill; `refuse`:
    why nothing is measured here; `moves_at`: at this size the first worker dies, and the next ones are on another machine;
    `dies_once`: at this size a worker dies, whoever comes first."""
    if refuse:
        raise SceneError("--size", 0, refuse)
    number, started = (int(word) for word in command.partition("# worker ")[2].partition(" ")[0].split("."))
    if moves_at is not None:
        kinds, number = 2, min(started, 2)
    summary = Summary(f"m{number % kinds}", name="fake")
    store.add_machine(summary.machine, f"Some CPU {number % kinds}", RECORD | {"kind": number % kinds})
    with (Path(log) / str(os.getpid())).open("a") as told:

        def missing(size: int) -> int:
            return REPEATS - store.sample_count(description(size), summary.machine, SOURCES)

        def measure(group: Sequence[int], tell: Tell) -> None:
            begin = time.monotonic()
            for size in group:
                if size == dies_once and not (Path(log) / "died").exists():
                    (Path(log) / "died").touch()
                    os.kill(os.getpid(), signal.SIGKILL)
                if size in poison or (size == moves_at and number == 1):
                    os.kill(os.getpid(), signal.SIGKILL)
                for _ in range(missing(size)):
                    time.sleep(seconds)
                    taken = time.monotonic_ns() / 1e9 + os.getpid()  # no two samples are alike
                    store.add_sample(summary.run, description(size), SOURCES, taken, 1)
                    told.write(f"sample {taken!r}\n")
                    told.flush()
                summary.measured += 1
            told.write(f"group {begin!r} {time.monotonic()!r}\n")
            told.flush()

        return resume(
            store, summary, groups, lambda size: missing(size) <= 0, measure, progress=progress, command=command
        )


def logged(folder: Path, what: str) -> list[list[float]]:
    """What all processes told of `sample`s or `group`s."""
    lines = [line.split() for file in folder.iterdir() for line in file.read_text().splitlines()]
    return [[float(word) for word in words[1:]] for words in lines if words[0] == what]


def sampled(store: Store) -> list[tuple[str, str, float]]:
    """Machine, configuration and seconds of every sample."""
    return store.query("SELECT machine, configuration, seconds FROM sample JOIN run ON run.key = run ORDER BY 1, 2, 3")


@dataclass
class ForkedJob:
    pid: int
    how: str | None = None

    def ended(self) -> str | None:
        if self.how is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.how = exit_words(os.waitstatus_to_exitcode(status)) if pid else None
        return self.how

    def kill(self) -> None:
        if self.ended() is None:
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
            self.how = "killed"


class ForkPool:
    """Workers as forks of this process. `work(folder, name)`: what one does."""

    queues = False

    def __init__(self, slots: int, work: Callable[[str, str], int] = main):
        self.slots, self.work = slots, work
        self.jobs: list[ForkedJob] = []

    def start(self, slot: int, folder: Path, name: str) -> ForkedJob:
        pid = os.fork()
        if pid == 0:
            status = 1
            try:
                status = self.work(str(folder), name)
            finally:
                os._exit(status)
        self.jobs.append(ForkedJob(pid))
        return self.jobs[-1]

    def close(self) -> None:
        for job in self.jobs:
            job.kill()
