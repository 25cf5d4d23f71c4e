"""Keys of measured configurations in the store: entered when they are measured, found again when the code has changed.

A measure `kernel_key` of a configuration holds, as its reason, the keys of its kernels and arrays and the version of
the measuring code (bench/keys/versions.py). Where the text of the sources changes but not this key, a measure
`same_kernels` says under which other sources the configuration counts as measured.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping

from softlab.bench.keys.ask import NO_KERNELS, keys_at
from softlab.bench.keys.versions import MEASURING, version_of
from softlab.bench.store.database import Store
from softlab.bench.store.schema import Description, configuration_hash
from softlab.bench.store.versions import BACKENDS, digest_of
from softlab.model.base.digest import ROOT

KEY = "kernel_key"
Measured = tuple[Description, str]  # a description and the text of its sources


def _has_kernels(description: Description) -> bool:
    return description.get("peer") is None and description.get("backend") in BACKENDS


def _keys(descriptions: Mapping[str, Description], experiment: str) -> dict[str, str]:
    """Return hash of a configuration -> its measure `kernel_key`; empty where this process runs no kernels."""
    if not descriptions or experiment not in MEASURING or any(os.environ.get(name, "0") != "0" for name in NO_KERNELS):
        return {}
    try:
        keys = keys_at(ROOT, {name: dict(description) for name, description in descriptions.items()})
    except (RuntimeError, OSError):  # the numbers are in the store; without a key they are older once the code changes
        return {}
    return {name: f"{kernels} {arrays} {version_of(experiment)}" for name, (kernels, arrays) in keys.items()}


def enter_keys(store: Store, run: str, experiment: str) -> None:
    """Enter the missing keys of the configurations that a run has measured."""
    rows = store.query(
        "SELECT DISTINCT hash, description, sources FROM (SELECT configuration, sources, run FROM sample UNION "
        "SELECT configuration, sources, run FROM measure) AS taken JOIN configuration ON hash = taken.configuration "
        "WHERE run = :run AND NOT EXISTS (SELECT 1 FROM measure WHERE measure.configuration = hash "
        "AND measure.sources = taken.sources AND name = :name)",
        {"run": run, "name": KEY},
    )
    descriptions = {name: json.loads(text) for name, text, _ in rows}
    keys = _keys({name: one for name, one in descriptions.items() if _has_kernels(one)}, experiment)
    with store.transaction():
        for name, _, sources in rows:
            if name in keys:
                store.add_measure(run, descriptions[name], sources, KEY, None, "", keys[name])


def same_kernels(store: Store, machine: str, cases: Iterable[Measured], experiment: str) -> dict[str, tuple[str, str]]:
    """Return hash -> (sources, other sources with the same key) of configurations that the store lacks under their sources.

    Under the other sources it was measured with the key that it has now.
    """
    wanted = {
        configuration_hash(description): (description, sources)
        for description, sources in cases
        if _has_kernels(description) and sources.startswith(digest_of(description["backend"]))
    }
    known: dict[str, dict[str, str]] = {}
    for name, sources, key in store.query(
        "SELECT configuration, sources, reason FROM measure JOIN run ON run.key = run WHERE machine = ? AND name = ? "
        "ORDER BY run.started",
        (machine, KEY),
    ):
        if name in wanted and sources != wanted[name][1]:
            known.setdefault(name, {})[key] = sources
    now = _keys({name: wanted[name][0] for name in known}, experiment)
    return {name: (wanted[name][1], known[name][key]) for name, key in now.items() if key in known[name]}
