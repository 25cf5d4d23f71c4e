"""Measurements of an older version of the code: how many a source holds, and the results without them.

A measurement is older where its kernels are not proved to be those of the code as it is (bench/keys/carried.py). A sentence
that changes without such measurements is marked; the captions of figures say how many a machine has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import lru_cache
from typing import TypeVar

from softlab.bench.keys.carried import DIGEST, is_older, read_map
from softlab.bench.keys.enter import KEY
from softlab.bench.peers.cases import peer_sources
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure, Timing
from softlab.bench.store.schema import SAME
from softlab.bench.store.versions import digest_of, sources_of
from softlab.plots.core.data import Results, Source

Item = TypeVar("Item", Timing, Measure)
UNKNOWN = "a commit that was not recorded"


def older_items(source: Source) -> Iterator[Timing | Measure]:
    """Yield the timings and measures of a source that are older."""
    same = same_kernels(source.measures)
    for item in _items(source):
        if is_older(item, item.configuration) and not same(item):
            yield item


def same_kernels(measures: Iterable[Measure]) -> Callable[[Timing | Measure], bool]:
    """Return a test for timings and measures of other sources whose kernels are the current ones by the store."""
    same = {
        (m.reason.partition("-")[0], m.configuration)
        for m in measures
        if m.name == SAME and m.reason and sources_of(m) == digest_of(m.backend)
    }
    return lambda item: (sources_of(item), item.configuration) in same


def _items(source: Source) -> Iterator[Timing | Measure]:
    yield from (*source.timings, *source.kernels, *source.findings)
    yield from (*source.costs.values(), *source.energies.values())
    yield from (measure for measure in source.measures if measure.name not in (KEY, SAME))


def older_peers(store: Store, machine: str) -> frozenset[str]:
    """Return the backends whose peers were timed with other sources than the current ones."""
    rows = store.query(
        "SELECT DISTINCT json_extract(description, '$.backend'), sources FROM sample JOIN run ON run.key = sample.run "
        "JOIN configuration ON hash = configuration WHERE machine = ? "
        "AND json_extract(description, '$.peer') IS NOT NULL AND json_extract(description, '$.finding') IS NULL",
        (machine,),
    )
    digests = {(backend, sources) for backend, sources in rows if DIGEST.fullmatch(sources)}
    return frozenset(backend for backend, _ in digests if (backend, peer_sources(backend)) not in digests)


def with_older(source: Source) -> Source:
    """Return the source with its text `older`."""
    items = list(older_items(source))
    if not items and not source.older_peers:
        return source
    every = sum(1 for _ in _items(source)) + len(source.peers)
    count = len(items) + sum(ratio.backend in source.older_peers for ratio in source.peers)
    return replace(source, older=f"{count} of its {every} numbers are older than this code ({_commits(source, items)})")


def _commits(source: Source, items: list[Timing | Measure]) -> str:
    """Return the origin of older numbers: `commit 1e405d5bab8c of 2026-11-23`."""
    known = read_map().commits
    commits = {sources_of(item): known.get(sources_of(item)) for item in items}
    runs = {
        digest: (run.version.commit, run.started[:10])
        for run in source.runs
        for digest in (run.version.cpu, run.version.gpu)
        if digest and run.version.commit
    }
    named: dict[str, str] = {}
    for digest, commit in commits.items():
        if origin := commit or runs.get(digest):
            named[origin[0]] = min(origin[1], named.get(origin[0], origin[1]))
    words = [f"commit {name} of {day}" for name, day in sorted(named.items(), key=lambda item: item[1])]
    unknown = not named or any(not commit and digest not in runs for digest, commit in commits.items())
    return ", ".join([*words, *([UNKNOWN] if unknown else [])])


@lru_cache(maxsize=8)
def without_older(results: Results) -> Results:
    """Return the results without older measurements; the same object where there are none."""
    if not any(source.older for source in results.sources):
        return results
    return Results(tuple(map(_without, results.sources)))


def _without(source: Source) -> Source:
    if not source.older:
        return source
    dropped = {id(item) for item in older_items(source)}

    def current(items: Iterable[Item]) -> tuple[Item, ...]:
        return tuple(item for item in items if id(item) not in dropped)

    def current_of(table: dict[str, Timing]) -> dict[str, Timing]:
        return {key: item for key, item in table.items() if id(item) not in dropped}

    return replace(
        source,
        timings=current(source.timings), kernels=current(source.kernels), findings=current(source.findings),
        measures=current(source.measures), costs=current_of(source.costs), energies=current_of(source.energies),
        peers=tuple(ratio for ratio in source.peers if ratio.backend not in source.older_peers), older="",
    )  # fmt: skip
