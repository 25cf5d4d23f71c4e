"""Committed measurements that are valid for the current code: those whose kernels are proved to be the same.

The column `sources` of a measurement is the digest of its sources. The map beside the data
(labbook/data/kernel_keys.json) lists, for each such digest, the commit that has it and the configurations whose kernels and
arrays had the same key at that commit as in the code that `as_of` names. Everything else is older. The map is written by
`python -m softlab.bench.keys.carry`.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from softlab.bench.store.versions import BACKENDS, Dated, digest_of, sources_of
from softlab.model.base.digest import ROOT

MAP = ROOT / "labbook" / "data" / "kernel_keys.json"
DIGEST = re.compile(r"[0-9a-f]{16}")


@dataclass(frozen=True)
class Group:
    """Configurations of one key: `sources` the digest that they were measured under, `kernels`, `arrays` the keys of the
    first of them, `proof` why their kernels are today's (`source` or `machine code`)."""

    sources: str
    backend: str
    kernels: str
    arrays: str
    proof: str
    configurations: tuple[str, ...]


@dataclass(frozen=True)
class Carried:
    """The map. `as_of`: the digest of each backend's sources that it was written for; `commits`: sources -> commit."""

    as_of: dict[str, str] = field(default_factory=dict)
    commits: dict[str, tuple[str, str]] = field(default_factory=dict)  # (commit, day)
    groups: tuple[Group, ...] = ()

    def write(self, path: Path = MAP) -> None:
        """Write the map as JSON, a group a line."""
        head = json.dumps({"as_of": self.as_of, "commits": self.commits})[:-1]
        lines = ",\n".join(
            json.dumps([g.sources, g.backend, g.kernels, g.arrays, g.proof, " ".join(g.configurations)])
            for g in self.groups
        )
        path.write_text(f'{head}, "groups": [\n{lines}\n]}}\n', encoding="utf-8")


def read_map(path: Path = MAP) -> Carried:
    """Read the map stored with the data; an empty one if there is none."""
    if not path.is_file():
        return Carried()
    data = json.loads(path.read_text(encoding="utf-8"))
    groups = tuple(
        Group(sources, backend, kernels, arrays, proof, tuple(names.split()))
        for sources, backend, kernels, arrays, proof, names in data["groups"]
    )
    return Carried(data["as_of"], {k: (v[0], v[1]) for k, v in data["commits"].items()}, groups)


@cache
def proved() -> frozenset[tuple[str, str]]:
    """Return (sources, configuration) of the committed measurements whose kernels are those of the code as it is
    now."""
    carried = read_map()
    current = {backend for backend in BACKENDS if carried.as_of.get(backend) == digest_of(backend)}
    return frozenset(
        (group.sources, configuration)
        for group in carried.groups
        if group.backend in current
        for configuration in group.configurations
    )


def is_older(item: Dated, configuration: str) -> bool:
    """True for a measurement of other sources than the current ones that is not proved to have the same kernels."""
    sources = sources_of(item)
    if item.backend not in BACKENDS or not DIGEST.fullmatch(sources) or sources == digest_of(item.backend):
        return False
    return (sources, configuration) not in proved()
