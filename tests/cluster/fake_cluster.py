"""An experiment of milliseconds for workers to measure, and a pool that forks them, so that none has to import
anything."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from softlab.bench.cluster.pools import Where, exit_words
from softlab.bench.cluster.start import on_cluster
from softlab.bench.cluster.worker import code_digests, main
from softlab.bench.measure.experiment import Report, Summary, backends_here, resume
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import load_scene

SOURCES, REPEATS = "s", 3
BEAT = 0.05  # s
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

        def measure(group: Sequence[int], tell: Report) -> None:
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


# ---------------------------------------------------------------------- forks


def ends_with_seven(folder: str, name: str) -> int:
    return 7


def sleeps(folder: str, name: str) -> int:
    Path(folder, "asleep").touch()
    time.sleep(3600)
    return 0


def sleeps_but_the_first(folder: str, name: str) -> int:
    return main(folder, name) if name.startswith("1.") else sleeps(folder, name)


def sweeps(path: str, name: str) -> int:
    """A whole sweep, with two workers."""
    groups, log, seconds = json.loads(name)
    with Store(path) as store:
        on_cluster(
            store, run_fake, Where("local"), timed=False, command="fake", progress=False, beat=BEAT,
            pool=lambda folder: ForkPool(2, server=ForkServer()),
            how={"groups": groups, "log": log, "seconds": seconds},
        )  # fmt: skip
    return 0


def serve() -> None:
    """Fork as asked on standard input: this process has all imported, and one thread alone, so that forks of it are sound."""
    code_digests(), description(2), backends_here(["cpu"])  # once, for all forks
    for line in sys.stdin:
        asked = json.loads(line)
        if "poll" in asked:
            pid, status = os.waitpid(asked["poll"], os.WNOHANG)
            answer = os.waitstatus_to_exitcode(status) if pid else None
        else:
            answer = os.fork()
            if answer == 0:
                work = globals().get(asked["work"], main)
                os.environ.update(asked["environment"])
                os.dup2(os.open(os.devnull, os.O_RDWR), 0)
                status = 1
                try:
                    status = work(*asked["arguments"])
                finally:
                    os._exit(status)
        print(json.dumps([asked["number"], answer]), flush=True)


class ForkServer:
    """A process that forks. It ends with this one."""

    def __init__(self) -> None:
        root = Path(__file__).parents[2]
        self.process = subprocess.Popen(
            [sys.executable, "-c", "import fake_cluster; fake_cluster.serve()"], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, text=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join([str(root), str(Path(__file__).parent)])},
        )  # fmt: skip
        self.turn, self.asked = threading.Lock(), 0

    def ask(self, **what: Any) -> Any:
        assert self.process.stdin is not None and self.process.stdout is not None
        with self.turn:
            self.asked += 1
            self.process.stdin.write(json.dumps(what | {"number": self.asked}) + "\n")
            self.process.stdin.flush()
            while True:  # Ctrl-C may have left the answer to an earlier question
                number, answer = json.loads(self.process.stdout.readline())
                if number == self.asked:
                    return answer

    def fork(self, work: str, *arguments: str) -> int:
        """The process that does `work`, a function of this file (main: a worker)."""
        environment = {name: os.environ[name] for name in ("XDG_CACHE_HOME",) if name in os.environ}
        return self.ask(work=work, arguments=arguments, environment=environment)

    def poll(self, pid: int) -> int | None:
        return self.ask(poll=pid)


fork_server = cache(ForkServer)  # of this process


@dataclass
class ForkedJob:
    server: ForkServer
    pid: int
    how: str | None = None

    def ended(self) -> str | None:
        if self.how is None:
            status = self.server.poll(self.pid)
            self.how = None if status is None else exit_words(status)
        return self.how

    def kill(self) -> None:
        if self.ended() is None:
            os.kill(self.pid, signal.SIGKILL)
            while self.ended() is None:
                time.sleep(0.01)


class ForkPool:
    """Workers as forks. `work`: what one does, a function of this file; `queues`: as of bench/cluster/pools.py."""

    def __init__(self, slots: int, work: str = "main", queues: bool = False, server: ForkServer | None = None):
        self.slots, self.work, self.queues = slots, work, queues
        self.server = server or fork_server()
        self.jobs: list[ForkedJob] = []

    def start(self, slot: int, folder: Path, name: str) -> ForkedJob:
        self.jobs.append(ForkedJob(self.server, self.server.fork(self.work, str(folder), name)))
        return self.jobs[-1]

    def close(self) -> None:
        for job in self.jobs:
            job.kill()
