"""Start of a sweep on many machines: its folder beside the store, remains of an earlier sweep, and its pool."""

from __future__ import annotations

import shutil
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from softlab.bench.cluster.dask_pool import DaskPool
from softlab.bench.cluster.folder import Folder, Order
from softlab.bench.cluster.intake import Intake
from softlab.bench.cluster.pools import Pool, SubmititPool, Where
from softlab.bench.cluster.summary import ClusterSummary
from softlab.bench.cluster.sweep import STILL_BEATS, Sweep
from softlab.bench.cluster.turns import try_lock
from softlab.bench.cluster.worker import code_digests
from softlab.bench.store.database import Store
from softlab.model.base.errors import InputError
from softlab.model.base.files import why

FOLDER = ".workers"  # replaces the store's suffix


def on_cluster(
    store: Store,
    run: Callable[..., Any],
    where: Where,
    *,
    timed: bool = True,
    command: str,
    progress: bool = True,
    beat: float = 1.0,
    pool: Callable[[Path], Pool] | None = None,
    how: Mapping[str, Any],
) -> ClusterSummary:
    """Measure what the store lacks of an experiment on the workers of `where`, and return a summary.

    `run(store, command=..., progress=..., **how)`: an experiment of bench/measure/experiment.py, which can be pickled.
    `timed`: each worker has its machine, or its GPU, reserved while it measures a group; otherwise nothing is timed,
    and several workers may share a machine. `beat` [s]: between signs of life. `pool`: makes another pool than `where`
    requests. Ctrl-C ends cleanly.

    Raises InputError (the store, its folder), BackendUnavailable (the pool), and the errors with which workers refuse.
    """
    with _alone_at(store) as base:
        unmerged = adopt(store, base, beat)
        folder = Folder(base / uuid.uuid4().hex[:8], make=True)
        backends = how.get("backends")
        timings = () if not timed else None if backends is None else tuple(backends)
        try:
            opened = pool(folder.path) if pool else pool_of(where, folder.path, timings)
        except BaseException:
            shutil.rmtree(folder.path, ignore_errors=True)
            raise
        order = Order(run, dict(how), command, timings, code_digests(), beat)
        name = getattr(run, "name", None) or getattr(run, "__name__", "sweep").removeprefix("run_")
        try:
            with _shared_references(store, folder):
                summary = Sweep(store, folder, opened, order, name, progress).run()
        finally:
            opened.close()
        summary.unmerged += unmerged
        return summary


def pool_of(where: Where, folder: Path, backends: Sequence[str] | None) -> Pool:
    """Return the requested pool. `backends`: what is timed, as in Order. Raises BackendUnavailable, InputError."""
    if where.kind == "dask":
        return DaskPool(where, timed=backends is None or bool(backends))
    return SubmititPool(where, folder / "logs", backends)


@contextmanager
def _alone_at(store: Store) -> Iterator[Path]:
    """Lock the folder beside the store for this sweep; remove it afterwards if it is empty."""
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
    """Link the folder of references beside the store into that of the workers' stores, where links exist."""
    beside = Path(store.path).absolute().parent / "references"
    with suppress(OSError):
        beside.mkdir(exist_ok=True)
        (folder.path / "stores" / "references").symlink_to(beside, target_is_directory=True)
    try:
        yield
    finally:
        with suppress(OSError):
            beside.rmdir()  # only if it is empty


def adopt(store: Store, base: Path, beat: float) -> list[str]:
    """Merge the results that workers of a killed sweep left, once they have stopped; return the reasons of failures."""
    unmerged: list[str] = []
    for path in sorted(entry for entry in base.iterdir() if (entry / "status").is_dir()):
        folder = Folder(path)
        folder.stop()
        _until_still(folder, beat)
        intake = Intake(store, folder)
        if intake.take_all():
            intake.clear()
        unmerged += intake.unmerged
    return unmerged


def _until_still(folder: Folder, beat: float) -> None:
    """Wait until each worker has reported its end, or gives no sign of life any more."""
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
