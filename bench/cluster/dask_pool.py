"""Workers as tasks of a Dask cluster, each a process beside the Dask worker that started it."""

from __future__ import annotations

import subprocess
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from softlab.bench.cluster.pools import EXTRA, Job, Where, command, exit_words
from softlab.model.base.errors import BackendUnavailable

DASK_SECONDS = 5.0  # time in which a scheduler must answer, and in which it restarts what died


@dataclass
class DaskJob:
    pool: DaskPool
    address: str
    future: Any

    def ended(self) -> str | None:
        if self.future.status == "finished":
            return exit_words(self.future.result())
        if self.future.status in ("error", "lost", "cancelled"):
            return f"its Dask task ended: {self.future.exception() if self.future.status == 'error' else self.future.status}"
        return None if self.address in self.pool.addresses() else f"the Dask worker {self.address} is gone"

    def kill(self) -> None:
        with suppress(Exception):  # the scheduler may be gone
            self.future.cancel()


class DaskPool:
    """Workers of a Dask cluster: one per host if something is timed, else all."""

    queues = False

    def __init__(self, where: Where, timed: bool):
        try:
            from distributed import Client
        except ImportError:
            raise BackendUnavailable("dask.distributed is not installed", EXTRA) from None
        self.where = f"dask://{where.address}"
        try:
            self.client: Any = Client(f"tcp://{where.address}", timeout=DASK_SECONDS, set_as_default=False)
        except (OSError, ValueError) as error:
            raise BackendUnavailable(
                f"no Dask scheduler answers at {self.where} within {DASK_SECONDS:g} s ({type(error).__name__})",
                "start one (dask scheduler) or check the address",
            ) from None
        self.jobs: dict[int, DaskJob] = {}
        addresses = self.addresses()
        hosts = {address.rpartition(":")[0] for address in addresses}
        if not addresses:
            self.close()
            raise BackendUnavailable(f"{self.where} has no workers", f"start some: dask worker {where.address}")
        self.slots = min(where.workers or len(addresses), len(hosts) if timed else len(addresses))

    def addresses(self) -> list[str]:
        """Return the addresses of the current workers. Raises BackendUnavailable if the scheduler is gone."""
        try:
            return sorted(self.client.nthreads())
        except (OSError, ValueError, RuntimeError) as error:
            raise BackendUnavailable(
                f"the Dask scheduler at {self.where} is gone ({type(error).__name__})",
                "start it, and the same command resumes",
            ) from None

    def start(self, slot: int, folder: Path, name: str) -> Job:
        others = {job.address for other, job in self.jobs.items() if other != slot and job.ended() is None}
        hosts = {address.rpartition(":")[0] for address in others}
        give_up = time.monotonic() + DASK_SECONDS  # Dask restarts within this time what died
        while not (free := [address for address in self.addresses() if address not in others]):
            if time.monotonic() > give_up:
                raise BackendUnavailable(f"{self.where} has no worker left", "start some, and the same command resumes")
            time.sleep(0.1)
        free.sort(key=lambda address: address.rpartition(":")[0] in hosts)
        future = self.client.submit(
            subprocess.call, command(folder, name), workers=[free[0]], allow_other_workers=False, pure=False, retries=0
        )
        self.jobs[slot] = DaskJob(self, free[0], future)
        return self.jobs[slot]

    def close(self) -> None:
        self.client.close(timeout=DASK_SECONDS)
