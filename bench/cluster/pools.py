"""Places where workers run: processes of this host or Slurm jobs, both by submitit, or workers of a Dask cluster.

A pool starts a worker's command in one of its slots and reports whether it still runs; everything else uses the folder.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from softlab.cpu_backend.core.threads import core_count
from softlab.model.base.errors import BackendUnavailable, SceneError, shortened

WEEK_MINUTES = 7 * 24 * 60
SLURM_WORKERS, SLURM_MINUTES = 4, 8 * 60  # defaults
CODE = (
    "import sys; sys.path.insert(0, sys.argv[1])\n"
    "from softlab.bench.cluster.worker import main; sys.exit(main(*sys.argv[2:]))"
)
EXTRA = 'pip install -e ".[cluster]"'


def _import_folder() -> str:
    """The folder from which a worker imports the package: the checkout, or where it is installed."""
    return str(Path(str(sys.modules["softlab"].__file__)).parents[1])


@dataclass(frozen=True)
class Where:
    """Request of `--cluster`.

    `kind`: local, slurm or dask; `address`: of Dask's scheduler; `workers`: their number, None: the pool's default;
    `sbatch`: options of Slurm jobs.
    """

    kind: str
    address: str = ""
    workers: int | None = None
    sbatch: dict[str, str] = field(default_factory=dict)


def where_of(cluster: str, workers: int | None, sbatch: Sequence[str] | None) -> Where:
    """Return the request from the command line. Raises SceneError."""
    if workers is not None and workers < 1:
        raise SceneError("--workers", workers, "must be at least 1")
    kind, _, address = cluster.partition("://")
    if cluster not in ("local", "slurm") and not (kind == "dask" and re.fullmatch(r"\S+:\d+", address)):
        raise SceneError("--cluster", cluster, "must be local, slurm, or dask://HOST:PORT of a scheduler that runs")
    options = {}
    for option in sbatch or ():
        name, is_, value = option.partition("=")
        if kind != "slurm" or not (is_ and re.fullmatch(r"[a-z][a-z-]*", name)):
            raise SceneError("--sbatch", option, "must be NAME=VALUE, as partition=gpu, and needs --cluster slurm")
        options[name] = value
    return Where(kind, address, workers, options)


class Job(Protocol):
    """Started command of a worker."""

    def ended(self) -> str | None:
        """Return None while it runs, else a description of how it ended, as far as the pool knows."""
        ...

    def kill(self) -> None:
        """End it by force."""
        ...


class Pool(Protocol):
    """Interface of a pool.

    `slots`: number of workers that run at once; `queues`: a worker may have to wait for a place.
    """

    slots: int
    queues: bool

    def start(self, slot: int, folder: Path, name: str) -> Job: ...

    def close(self) -> None: ...


def command(folder: Path, name: str) -> list[str]:
    """Return the command that starts a worker, in any folder and environment."""
    return [sys.executable, "-c", CODE, _import_folder(), str(folder), name]


def exit_words(status: int) -> str:
    """Return how a process ended, in words."""
    return f"killed by signal {-status}" if status < 0 else f"ended with exit status {status}"


# ---------------------------------------------------------------------- submitit


@dataclass
class SubmititJob:
    job: Any

    def ended(self) -> str | None:
        if not self.job.done():
            return None
        reason = f"job {self.job.state}"
        if self.job.paths.result_pickle.exists():
            with suppress(Exception):  # a job that could not even begin has its reason in its output
                reason = exit_words(self.job.result())
        lines = (self.job.stderr() or "").strip().splitlines()
        return f"{reason}: {shortened(lines[-1], 200)}" if lines else reason

    def kill(self) -> None:
        with suppress(Exception):  # the queue may not answer any more
            self.job.cancel()


class SubmititPool:
    """Processes of this host, or Slurm jobs, each with a node of its own if something is timed."""

    def __init__(self, where: Where, logs: Path, backends: Sequence[str] | None):
        try:
            import submitit
        except ImportError:
            raise BackendUnavailable("submitit is not installed, which starts workers", EXTRA) from None
        self.devices: list[str | None] = [None]
        if where.kind == "local":
            self.devices = _devices(backends)
            usual = len(self.devices) if backends is None or backends else core_count()
            self.executor: Any = submitit.LocalExecutor(logs)
            self.executor.update_parameters(timeout_min=WEEK_MINUTES)
        else:
            if shutil.which("sbatch") is None:
                raise BackendUnavailable(
                    "no Slurm here: sbatch is not on the PATH",
                    "run it where jobs are submitted, or use --cluster local",
                )
            usual = SLURM_WORKERS
            self.executor = submitit.SlurmExecutor(logs)
            timed = backends is None or bool(backends)
            options = {name.replace("-", "_"): value for name, value in where.sbatch.items()}
            self.executor.update_parameters(  # without srun, which would give its step one core
                job_name="softlab", time=SLURM_MINUTES, use_srun=False, exclusive=timed or None,
                additional_parameters=options,
            )  # fmt: skip
        self.slots = where.workers or usual
        self.local = where.kind == "local"
        self.queues = not self.local

    def start(self, slot: int, folder: Path, name: str) -> Job:
        environment = None
        if self.local:
            device = self.devices[slot % len(self.devices)]
            environment = dict(os.environ) | ({} if device is None else {"CUDA_VISIBLE_DEVICES": device})
        try:
            with _no_interrupts():
                return SubmititJob(self.executor.submit(subprocess.call, command(folder, name), env=environment))
        except Exception as error:  # submitit's errors depend on the queue
            raise BackendUnavailable(f"the job was refused ({error})", "see --sbatch NAME=VALUE") from None

    def close(self) -> None:
        """Release nothing: the pool has no resources."""


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Block Ctrl-C for processes that are started inside.

    A terminal sends it to all that were started from it, but the sweep stops its workers in its own way.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    old = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, old)


def _devices(backends: Sequence[str] | None) -> list[str | None]:
    """Return for each slot the only GPU that it sees, if nothing but GPUs is timed; None: all."""
    if list(backends or ()) != ["gpu"]:
        return [None]
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    if visible:
        return list(visible.split(","))
    from softlab.bench.measure.gpu import gpu_facts

    return [str(k) for k in range(gpu_facts()["gpu_count"] or 1)]
