"""An experiment on many machines: start, watch and restart workers, and merge their results as they arrive.

The process of the sweep measures nothing itself. The store of a lost worker is merged and its groups become free; the
worker that claims one continues it, so that nothing is lost or done twice. A group whose workers died `DEATHS` times is
given up, and so is a slot whose workers died that often without a group.
"""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from dataclasses import dataclass

from softlab.bench.cluster.bar import WorkerBars
from softlab.bench.cluster.folder import ABANDONED, DONE, REFUSED, Folder, Order, Status
from softlab.bench.cluster.intake import Intake
from softlab.bench.cluster.pools import Job, Pool
from softlab.bench.cluster.summary import ClusterSummary, count
from softlab.bench.cluster.turns import host_name
from softlab.bench.store.database import Store
from softlab.bench.store.transfer import export, last_run
from softlab.model.base.errors import BackendUnavailable, InputError

DEATHS = 3  # number of deaths after which a group, or a slot, is given up
STILL_BEATS = 3  # number of beats without a sign of life after which a worker whose job has ended is lost
STOP_SECONDS = 30.0  # time for workers to stop when told to


@dataclass
class Slot:
    """A slot for one worker at a time. `name`: name of the current worker; `job`: its job (None: there is none);
    `seen`: last sign of life of a worker whose job ended, and its time; `deaths`: deaths of workers without a group;
    `stop_reason`: why the slot starts no more workers.
    """

    number: int
    started: int = 0
    name: str = ""
    job: Job | None = None
    seen: tuple[int, float] | None = None
    deaths: int = 0
    stop_reason: str = ""


class Sweep:
    """State of one sweep, with its workers in `pool` and everything else in `folder`."""

    def __init__(self, store: Store, folder: Folder, pool: Pool, order: Order, name: str, progress: bool = True):
        self.store, self.folder, self.pool, self.order = store, folder, pool, order
        self.summary, self._before = ClusterSummary("", name=name), last_run(store)
        self.slots = [Slot(number) for number in range(pool.slots)]
        self.intake = Intake(store, folder)
        self.statuses: dict[str, Status] = {}
        self.done: set[str] = set()
        self.deaths: dict[str, int] = {}
        self.refused: Status | None = None
        self.bars = WorkerBars(progress)
        self._beats = 0

    def run(self) -> ClusterSummary:
        """Run until nothing is left to measure, or Ctrl-C. Raises SoftlabError if no worker could do anything."""
        export(self.store, self.folder.seed)
        self.folder.write_order(self.order)
        try:
            with self.bars:
                for slot in self.slots:
                    self._start(slot)
                while self._check_workers():
                    time.sleep(self.order.beat / 2)
        except KeyboardInterrupt:
            self.summary.interrupted = True
        finally:
            self._end()
        count(self.summary, self.store, self._before, self.statuses.values())
        if self._nobody_worked():
            self._refuse()
        return self.summary

    # ------------------------------------------------------------------ watching

    def _check_workers(self) -> bool:
        """Check all workers once; return False if none is left."""
        self._beats += 1
        self.folder.live(self._beats)
        self.intake.take_outs()
        for slot in self.slots:
            if slot.job is not None:
                self._check(slot)
        self.bars.show(self.folder.plan(), self.done, self.statuses.values(), [slot.name for slot in self.slots])
        if self.pool.queues and self._nothing_left():
            self._let_go()
        left = self._orphaned()
        for slot in [slot for slot in self.slots if slot.job is None and not slot.stop_reason][: len(left)]:
            self._start(slot)
        return any(slot.job is not None for slot in self.slots)

    def _left(self) -> set[str]:
        """Return the groups that are neither done nor claimed nor given up."""
        return set(self.folder.plan()) - self.done - set(self.folder.claims())

    def _nothing_left(self) -> bool:
        """Return True if all planned groups are done or given up."""
        plan = set(self.folder.plan())
        return bool(plan) and plan <= self.done | {c for c, name in self.folder.claims().items() if name == ABANDONED}

    def _let_go(self) -> None:
        """Cancel jobs that still wait for a slot."""
        for slot in self.slots:
            if slot.job is not None and self.folder.status(slot.name) is None:
                slot.job.kill()
                slot.job = None

    def _orphaned(self) -> set[str]:
        """Return the groups left for a kind of machine without a worker, as far as the current workers reported theirs."""
        running = [self.statuses.get(slot.name) for slot in self.slots if slot.job is not None]
        if not all(status and status.machine for status in running):
            return set()
        here = {status.machine for status in running if status}
        return {claim for claim in self._left() if claim.partition(".")[0] not in here}

    def _check(self, slot: Slot) -> None:
        assert slot.job is not None
        how = slot.job.ended()  # before the status, which may still receive a last entry
        status = self.folder.status(slot.name)
        if status is not None:
            self._hear(slot, status)
        if status is not None and status.ended:
            self._ended(slot, status)
        elif how is not None:
            beat, now = status.beat if status else 0, time.monotonic()
            if slot.seen is None or slot.seen[0] != beat:
                slot.seen = beat, now
            elif now - slot.seen[1] > STILL_BEATS * self.order.beat:
                self._lost(slot, how, status)

    def _hear(self, slot: Slot, status: Status) -> None:
        self.statuses[slot.name] = status
        if new := set(status.done) - self.done:
            self.done |= new
            slot.deaths = 0

    def _ended(self, slot: Slot, status: Status) -> None:
        """Handle a worker that reported its end."""
        if status.ended == REFUSED:  # the next worker would refuse too
            self.refused = status
            slot.stop_reason, slot.job = status.reason, None
            self.summary.abandoned.append(f"worker {slot.name} on host {status.host}: {status.reason}")
            self.intake.take(self.folder.store_of(slot.name))
        elif status.ended == DONE:
            self.intake.take(self.folder.store_of(slot.name))
            slot.job = None
            if self._orphaned() and not status.done:  # otherwise workers that find nothing would be started forever
                self._count_death(
                    slot, "no worker takes the remaining groups; is there no such machine any more?", "came to nothing"
                )
        else:
            self._lost(slot, status.reason, status)

    def _lost(self, slot: Slot, why: str, status: Status | None) -> None:
        """Merge the store of a lost worker, free its groups, and start another one in its place."""
        self.intake.take(self.folder.store_of(slot.name))
        claims = [claim for claim, name in self.folder.claims().items() if name == slot.name and claim not in self.done]
        at = f" at {status.doing}" if status and claims else ""
        self.summary.losses.append(f"worker {slot.name}{f' on host {status.host}' if status else ''}{at}: {why}")
        if self.folder.store_of(slot.name).exists():
            self.folder.lose(slot.name)
        for claim in claims:
            self.deaths[claim] = self.deaths.get(claim, 0) + 1
            if self.deaths[claim] >= DEATHS:
                self.folder.abandon(claim)
                what = self.folder.words().get(claim, claim)
                self.summary.abandoned.append(f"{what}: its workers died {DEATHS} times, at last: {why}")
            else:
                self.folder.release(claim)
        slot.job = None
        if not claims:
            self._count_death(slot, why)
        if not slot.stop_reason:
            self._start(slot)

    def _count_death(self, slot: Slot, why: str, what: str = "died") -> None:
        slot.deaths += 1
        if slot.deaths >= DEATHS:
            slot.stop_reason = why
            self.summary.abandoned.append(f"worker {slot.number + 1}: {what} {DEATHS} times, at last: {why}")

    def _start(self, slot: Slot) -> None:
        if slot.stop_reason:
            return
        slot.started += 1
        slot.name, slot.seen = f"{slot.number + 1}.{slot.started}", None
        try:
            slot.job = self.pool.start(slot.number, self.folder.path, slot.name)
        except BackendUnavailable as error:
            if not any(other.job for other in self.slots):
                raise
            slot.stop_reason, slot.job = str(error), None
            self.summary.abandoned.append(f"worker {slot.name}: {error}")

    # ------------------------------------------------------------------ the end

    def _end(self) -> None:
        """Stop the remaining workers, merge all results, and remove the folder if everything is in the store."""
        with suppress(KeyboardInterrupt):  # a second Ctrl-C stops by force
            self._stop_workers()
        if not self.summary.interrupted and (left := self._left()):
            self.summary.abandoned.append(f"{len(left)} groups were not taken by any worker; the same command resumes")
        for slot in self.slots:
            if slot.job is not None:
                _kill(self.folder.status(slot.name))
                slot.job.kill()
        taken = self.intake.take_all()
        explained = self.refused is not None or self.summary.interrupted or not any(slot.deaths for slot in self.slots)
        if taken and (explained or not self._nobody_worked()):
            self.intake.clear()
        self.summary.unmerged += self.intake.unmerged

    def _stop_workers(self) -> None:
        if not any(slot.job for slot in self.slots):
            return
        self.folder.stop()
        deadline = time.monotonic() + STOP_SECONDS
        while any(slot.job for slot in self.slots) and time.monotonic() < deadline:
            for slot in self.slots:
                if slot.job is not None and self._gone(slot):
                    slot.job = None
            time.sleep(self.order.beat / 4)

    def _gone(self, slot: Slot) -> bool:
        """Return True if the slot's worker has stopped."""
        status = self.folder.status(slot.name)
        if status is not None:
            self._hear(slot, status)
            if status.ended:
                return True
        with suppress(BackendUnavailable):  # a pool that does not answer says nothing about its workers
            return slot.job is None or slot.job.ended() is not None
        return False

    def _nobody_worked(self) -> bool:
        """Return True if no worker got as far as reporting its machine; its output may explain why."""
        return not self.summary.interrupted and not any(status.machine for status in self.statuses.values())

    def _refuse(self) -> None:
        """Raise the error that the workers reported, or else one that describes how they ended."""
        if self.refused is not None:
            error = InputError(self.refused.reason)
            error.exit_status = self.refused.exit_status
            raise error
        why = next((slot.stop_reason for slot in self.slots if slot.stop_reason), "no reason is known")
        raise BackendUnavailable(
            f"no worker can be kept running: {why}", f"what they printed is in {self.folder.path / 'logs'}"
        )


def _kill(status: Status | None) -> None:
    """Kill a worker of this host that does not stop."""
    if status is not None and not status.ended and status.host == host_name():
        with suppress(OSError):
            os.kill(status.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
