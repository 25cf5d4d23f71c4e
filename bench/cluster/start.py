"""From what was typed to a sweep on many machines: its folder beside the store, what an earlier one left there, its pool."""

from __future__ import annotations

import shutil
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from bench.cluster.folder import Folder, Order
from bench.cluster.intake import Intake
from bench.cluster.pools import Pool, Where, pool_of
from bench.cluster.summary import ClusterSummary
from bench.cluster.sweep import STILL_BEATS, Sweep
from bench.cluster.turns import try_lock
from bench.cluster.worker import code_digests
from bench.store.database import Store
from model.core.errors import InputError
from model.core.files import why

FOLDER = ".workers"  # in place of the store's suffix


def on_cluster(
    store: Store,
    run: Any,
    where: Where,
    *,
    timed: bool = True,
    command: str,
    progress: bool = True,
    beat: float = 1.0,
    pool: Callable[[Path], Pool] | None = None,
    **how: Any,
) -> ClusterSummary:
    """Measure what the store lacks of an experiment on the workers of `where`, and say what was done. Ctrl-C ends cleanly.

    `run(store, command=..., progress=..., **how)`: an experiment of the frame (bench/measure/experiment.py), which pickles.
    `timed`: each worker has its machine, or its GPU, to itself while it measures a group; else nothing is timed, and workers
    may be packed. `beat` [s]: between signs of life. `pool`: makes another one than `where` asks for.

    Raises InputError (the store, its folder), BackendUnavailable (what starts workers), and what the workers refuse.
    """
    with _alone_at(store) as base:
        kept = adopt(store, base, beat)
        folder = Folder(base / uuid.uuid4().hex[:8], make=True)
        backends = how.get("backends")
        timings = () if not timed else None if backends is None else tuple(backends)
        try:
            opened = pool(folder.path) if pool else pool_of(where, folder.path, timings)
        except BaseException:
            shutil.rmtree(folder.path, ignore_errors=True)
            raise
        order = Order(run, how, command, timings, code_digests(), beat)
        name = getattr(run, "name", None) or getattr(run, "__name__", "sweep").removeprefix("run_")
        try:
            with _shared_references(store, folder):
                summary = Sweep(store, folder, opened, order, name, progress).run()
        finally:
            opened.close()
        summary.kept += kept
        return summary


@contextmanager
def _alone_at(store: Store) -> Iterator[Path]:
    """The folder beside the store, which no other sweep uses meanwhile; gone afterwards if nothing is left in it."""
    if store.path == ":memory:":
        raise InputError("workers need a store on disk, beside which they keep theirs; give --store FILE")
    base = Path(store.path).absolute().with_suffix(FOLDER)
    try:
        base.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{base} cannot be made: {why(error)}; make its folder writable, or give another --store"
        ) from None
    lock = try_lock(base / "lock")
    if lock is None:
        raise InputError(
            f"{base}: another sweep's workers are at this store; wait for it to end, or give another --store"
        )
    try:
        yield base
    finally:
        lock.close()
        with suppress(OSError):
            (base / "lock").unlink()
            base.rmdir()


@contextmanager
def _shared_references(store: Store, folder: Folder) -> Iterator[None]:
    """What is kept beside the store is kept beside the workers' stores, where the system has links of folders."""
    beside = Path(store.path).absolute().parent / "references"
    with suppress(OSError):
        beside.mkdir(exist_ok=True)
        (folder.path / "stores" / "references").symlink_to(beside, target_is_directory=True)
    try:
        yield
    finally:
        with suppress(OSError):
            beside.rmdir()  # if nothing is in it


def adopt(store: Store, base: Path, beat: float) -> list[str]:
    """Take over what workers of a sweep that was killed left, once they have stopped; what could not be merged, and why."""
    kept: list[str] = []
    for path in sorted(entry for entry in base.iterdir() if (entry / "status").is_dir()):
        folder = Folder(path)
        folder.stop()
        _until_still(folder, beat)
        intake = Intake(store, folder)
        if intake.take_all():
            intake.clear()
        kept += intake.kept
    return kept


def _until_still(folder: Folder, beat: float) -> None:
    """Until each of its workers has said that it ended, or says nothing any more."""
    beats: dict[str, int] = {}
    still = 0
    while still <= STILL_BEATS:
        statuses = [folder.status(name) for name in folder.workers()]
        now = {status.name: status.beat for status in statuses if status is not None and not status.ended}
        if not now:
            return
        still = still + 1 if now == beats else 0
        beats = now
        time.sleep(2 * beat)
