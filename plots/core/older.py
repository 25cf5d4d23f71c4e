"""Measurements of an older version of the code: how many a source holds, and the results without them.

A measurement is older where its kernels are not proved to be those of the code as it is (bench/keys/carried.py). A sentence
that changes without such measurements is marked; the captions of figures say how many a machine has.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

from bench.keys.carried import is_older, read_map
from bench.peers.cases import peer_sources
from bench.store.database import Store
from bench.store.versions import sources_of
from plots.core.data import Results, Source

UNKNOWN = "a commit that was not recorded"


def older_items(source: Source) -> Iterator[Any]:
    """The timings and measures of a source that are older."""
    for item in _items(source):
        if is_older(item, item.configuration):
            yield item


def _items(source: Source) -> Iterator[Any]:
    yield from (*source.timings, *source.kernels, *source.findings, *source.measures)
    yield from (*source.costs.values(), *source.energies.values())


def older_peers(store: Store, machine: str) -> frozenset[str]:
    """The backends whose peers were timed beside other sources than today's."""
    found = store.query(
        "SELECT DISTINCT json_extract(description, '$.backend'), sources FROM sample JOIN run ON run.key = sample.run "
        "JOIN configuration ON hash = configuration WHERE machine = ? "
        "AND json_extract(description, '$.peer') IS NOT NULL AND json_extract(description, '$.finding') IS NULL",
        (machine,),
    )
    newest = {backend for backend, _ in found}
    return frozenset(backend for backend in newest if (backend, peer_sources(backend)) not in found)


def with_older(source: Source) -> Source:
    """The source with `older` said."""
    found = list(older_items(source))
    if not found and not source.older_peers:
        return source
    every = sum(1 for _ in _items(source)) + len(source.peers)
    count = len(found) + sum(ratio.backend in source.older_peers for ratio in source.peers)
    return replace(source, older=f"{count} of its {every} numbers are older than this code ({_commits(source, found)})")


def _commits(source: Source, found: list[Any]) -> str:
    """`commit 1e405d5bab8c of 2026-11-23`: where older numbers are from."""
    known = read_map().commits
    told = {sources_of(item): known.get(sources_of(item)) for item in found}
    runs = {
        digest: (run.version.commit, run.started[:10])
        for run in source.runs
        for digest in (run.version.cpu, run.version.gpu)
        if digest and run.version.commit
    }
    words = [commit or runs.get(digest) for digest, commit in told.items()]
    named = sorted({f"commit {word[0]} of {word[1]}" for word in words if word}, key=lambda text: text[-10:])
    return ", ".join([*named, *([UNKNOWN] if not named or None in words else [])])


@lru_cache(maxsize=8)
def without_older(results: Results) -> Results:
    """The results without older measurements; the same object where there are none."""
    if not any(source.older for source in results.sources):
        return results
    return Results(tuple(map(_without, results.sources)))


def _without(source: Source) -> Source:
    if not source.older:
        return source
    dropped = {id(item) for item in older_items(source)}
    lists = {
        name: tuple(item for item in getattr(source, name) if id(item) not in dropped)
        for name in ("timings", "kernels", "findings", "measures")
    }
    tables = {
        name: {key: item for key, item in getattr(source, name).items() if id(item) not in dropped}
        for name in ("costs", "energies")
    }
    peers = tuple(ratio for ratio in source.peers if ratio.backend not in source.older_peers)
    return replace(source, **lists, **tables, peers=peers, older="")
