"""Write the map of committed measurements that are still valid: python -m softlab.bench.keys.carry [--check]

For each digest of sources in the data it finds the commit with that digest among those that the runs name. It opens each
configuration under that commit and under the current code, and lists those whose kernels and arrays have the same key. Where
only the source differs, it compares the machine code. `--check` is quick: it compares the key of one configuration of each
group with the map, and keeps the groups where they agree.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from softlab.bench.keys.ask import Descriptions, Key, keys_at
from softlab.bench.keys.carried import MAP, Carried, Group, read_map
from softlab.bench.store.database import Store
from softlab.bench.store.transfer import load_text
from softlab.bench.store.versions import BACKENDS, digest_of, read_version
from softlab.model.base.digest import ROOT

DIGESTS = """
import importlib.util as u, pathlib, sys
(path,) = pathlib.Path("model").glob("*/digest.py")  # its package depends on the commit
s = u.spec_from_file_location("digest", path); m = u.module_from_spec(s); sys.modules["digest"] = m
s.loader.exec_module(m); print(*(m.source_digest(*m.backend_sources(b)) for b in ("cpu", "gpu")))
"""


def measured(store: Store) -> dict[tuple[str, str], Descriptions]:
    """Return (digest of the sources, backend) -> configurations measured under it, without those of other programs."""
    configurations: dict[tuple[str, str], Descriptions] = {}
    for sources, name, text in store.query(
        "SELECT DISTINCT sources, hash, description FROM (SELECT sources, configuration FROM sample UNION "
        "SELECT sources, configuration FROM measure) JOIN configuration ON hash = configuration"
    ):
        description = json.loads(text)
        if description["backend"] in BACKENDS and description.get("peer") is None:
            configurations.setdefault((sources.partition("-")[0], description["backend"]), {})[name] = description
    return configurations


def commits_named(store: Store) -> list[str]:
    """Return the commits that runs name, without the mark of changed files."""
    named = (read_version(text).commit for (text,) in store.query("SELECT DISTINCT commit_hash FROM run"))
    return sorted({commit.rstrip("+") for commit in named if commit})


@contextmanager
def checkout(commit: str) -> Iterator[Path]:
    """Provide a folder with the files of a commit."""
    with tempfile.TemporaryDirectory(prefix="softlab-commit-") as folder:
        archive = subprocess.run(["git", "-C", str(ROOT), "archive", commit], check=True, capture_output=True)
        subprocess.run(["tar", "-x", "-C", folder], input=archive.stdout, check=True)
        yield Path(folder)


def digests_at(commit: str) -> dict[str, str]:
    """Return the digest of each backend's sources at a commit, by that commit's own rule; empty where it has none."""
    try:
        with checkout(commit) as folder:
            done = subprocess.run(
                [sys.executable, "-c", DIGESTS], cwd=folder, check=True, capture_output=True, text=True
            )
    except subprocess.CalledProcessError:
        return {}
    return dict(zip(BACKENDS, done.stdout.split(), strict=True))


def day_of(commit: str) -> str:
    """Return the day of a commit, `2026-11-23`."""
    command = ["git", "-C", str(ROOT), "show", "-s", "--format=%cs", commit]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


# ---------------------------------------------------------------------- the map


def groups_of(
    sources: str, backend: str, before: dict[str, Key], now: dict[str, Key], proof: str = "source"
) -> list[Group]:
    """Group the configurations that have the same key before and now by that key."""
    names_by_key: dict[Key, list[str]] = {}
    for name in sorted(before):
        if before[name] == now.get(name):
            names_by_key.setdefault(before[name], []).append(name)
    groups: dict[str, tuple[str, list[str]]] = {}
    for (kernels, arrays), names in names_by_key.items():
        groups.setdefault(kernels, (arrays, []))[1].extend(names)
    return [
        Group(sources, backend, kernels, arrays, proof, tuple(names)) for kernels, (arrays, names) in groups.items()
    ]


def by_machine_code(
    folder: Path, sources: str, backend: str, descriptions: Descriptions, before: dict[str, Key], now: dict[str, Key]
) -> list[Group]:
    """Group configurations whose kernels differ in source, but have the same arrays and compile to the same code."""
    pairs: dict[tuple[Key, Key], list[str]] = {}
    for name, key in before.items():
        if name in now and key[0] != now[name][0] and key[1] == now[name][1]:
            pairs.setdefault((key, now[name]), []).append(name)
    examples: dict[tuple[str, str], str] = {}
    for (old, new), names in pairs.items():
        examples.setdefault((old[0], new[0]), names[0])
    asked = {name: descriptions[name] for name in examples.values()}
    old_code, new_code = keys_at(folder, asked, "code"), keys_at(ROOT, asked, "code")
    same = {pair for pair, name in examples.items() if name in old_code and old_code[name] == new_code.get(name)}
    names_by_kernels: dict[str, list[str]] = {}
    for (old, new), names in pairs.items():
        if (old[0], new[0]) in same:
            names_by_kernels.setdefault(new[0], []).extend(names)
    return [
        Group(sources, backend, kernels, now[names[0]][1], "machine code", tuple(sorted(names)))
        for kernels, names in names_by_kernels.items()
    ]


def maps(store: Store, code: bool) -> Iterator[tuple[Carried, str]]:
    """Yield the growing map of a store's measurements and a line on the last digest. `code`: compare machine code, too,
    which takes minutes."""
    measurements = measured(store)
    commits: dict[tuple[str, str], str] = {}
    for named in commits_named(store):
        for backend, digest in digests_at(named).items():
            commits.setdefault((digest, backend), named)
    known = Carried({backend: digest_of(backend) for backend in BACKENDS})
    for (sources, backend), descriptions in sorted(measurements.items(), key=lambda item: len(item[1]), reverse=True):
        commit = commits.get((sources, backend))
        if commit is None:
            yield known, f"{sources} {backend}: no commit reproduces it, {len(descriptions)} configurations are older"
            continue
        with checkout(commit) as folder:
            before, now = keys_at(folder, descriptions), keys_at(ROOT, descriptions)
            groups = groups_of(sources, backend, before, now)
            groups += by_machine_code(folder, sources, backend, descriptions, before, now) if code else []
        known = Carried(known.as_of, known.commits | {sources: (commit, day_of(commit))}, (*known.groups, *groups))
        carried = sum(len(group.configurations) for group in groups)
        yield (
            known,
            f"{sources} {backend}, commit {commit}: {carried} of {len(descriptions)} configurations carried over",
        )


def checked(known: Carried, store: Store) -> Carried:
    """Return the groups of a map that are still valid: their first configuration has the map's key under the current
    code."""
    descriptions = {
        name: description for configurations in measured(store).values() for name, description in configurations.items()
    }
    first = {group.configurations[0]: descriptions[group.configurations[0]] for group in known.groups}
    now = keys_at(ROOT, first)
    good = [group for group in known.groups if now.get(group.configurations[0]) == (group.kernels, group.arrays)]
    return replace(known, as_of={backend: digest_of(backend) for backend in BACKENDS}, groups=tuple(good))


def summary(carried: Carried, store: Store) -> Iterator[str]:
    """Count the rows of each kind that are carried over, by proof."""
    proofs = {(g.sources, name): g.proof for g in carried.groups for name in g.configurations}
    rows: Counter[tuple[str, str]] = Counter()
    for table in ("sample", "measure"):
        for sources, name, count in store.query(
            f"SELECT sources, configuration, count(*) FROM {table} GROUP BY sources, configuration"
        ):
            rows[table, proofs.get((sources.partition("-")[0], name), "older")] += count
    for (table, proof), count in sorted(rows.items()):
        yield f"{table}: {count} {proof if proof == 'older' else f'carried over by {proof}'}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write or check the map, and print how many rows are carried over by which proof."""
    parser = argparse.ArgumentParser(prog="python -m softlab.bench.keys.carry", description=__doc__)
    parser.add_argument("--check", action="store_true", help="check the map that is there, in a minute")
    parser.add_argument("--code", action="store_true", help="compare machine code where the source differs")
    asked = parser.parse_args(arguments)
    with load_text(sorted(MAP.parent.glob("*.csv.gz"))) as store:
        progress = [(checked(read_map(), store), "checked")] if asked.check else maps(store, asked.code)
        for carried, text in progress:
            carried.write()
            print(text, flush=True)
        print("\n".join(summary(carried, store)))


if __name__ == "__main__":
    main()
