"""Version of the code of a measurement, which decides which measurements may be compared.

Two timings are compared only where they are of one version of the code: those of one backend if its sources were the same;
CPU against GPU if some run names the sources of both, because those then lay side by side. Every run records both when it is
entered (`code_version`). Other pairs are not compared: there is no sentence and no line.
"""

from __future__ import annotations

import os
import subprocess
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol, TypeVar

from softlab.model.base.digest import ROOT, backend_sources, source_digest
from softlab.model.base.errors import InputError

BACKENDS = ("cpu", "gpu")
MEASURING = (  # files that decide what a measurement is
    "app", "bench", "cpu_backend", "gpu_backend", "model", "pyproject.toml", "setup.py", "softlab",
)  # fmt: skip
COMMIT = "SOFTLAB_COMMIT"  # environment variable: the revision of a copy that has no history of its own


@dataclass(frozen=True)
class Version:
    """Version of the code: `commit`, the revision, with a `+` if files differed from it, None if unknown; `cpu` and
    `gpu`, the digests of the backends' sources, None in the records of earlier labs."""

    commit: str | None
    cpu: str | None = None
    gpu: str | None = None

    def __str__(self) -> str:
        """Return the version for captions: `commit 9613136a2b1c`, or a substitute."""
        if self.commit:
            return f"commit {self.commit}"
        return f"sources {self.cpu[:8]} and {self.gpu[:8]}" if self.cpu and self.gpu else "commit unknown"


def code_version() -> str:
    """Version of the code for the record of a run: `9613136a2b1c+ cpu:<digest> gpu:<digest>`; the revision is `-` outside a
    checkout, unless SOFTLAB_COMMIT names it."""
    return " ".join([_revision() or "-", *(f"{name}:{digest_of(name)}" for name in BACKENDS)])


@cache
def digest_of(backend: str) -> str:
    """Return the digest of a backend's present sources."""
    return source_digest(*backend_sources(backend))


def read_version(text: str | None) -> Version:
    """Parse the version of a run's entry; runs of earlier labs have the revision at most."""
    commit, *others = (text or "-").split()
    digests = dict(word.split(":", 1) for word in others if ":" in word)
    return Version(None if commit == "-" else commit, digests.get("cpu"), digests.get("gpu"))


def _revision() -> str | None:
    """The revision of the lab's own files, `+` added where they differ from it; None where unknown."""
    named = os.environ.get(COMMIT, "").strip()
    if named or not (ROOT / ".git").exists():
        return named.split()[0] if named else None
    try:

        def git(*words: str) -> str:
            done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, timeout=10)
            return done.stdout.strip() if done.returncode == 0 else ""

        revision = git("rev-parse", "--short=12", "HEAD")
        changed = git("status", "--porcelain", "--", *MEASURING) if revision else ""
        return revision + "+" * bool(changed) if revision else None
    except (OSError, subprocess.SubprocessError):
        return None


def refuse_changed_files(allowed: bool) -> None:
    """Raise InputError where the lab's files differ from their commit, unless that is `allowed`: no measurement could be
    traced to its code."""
    revision = _revision() or ""
    if revision.endswith("+") and not allowed:
        raise InputError(
            f"the lab's files differ from commit {revision.rstrip('+')}, so these measurements could not "
            "be traced to their code; commit the changes, or measure with softlab --allow-dirty COMMAND, which marks "
            "every run"
        )


# ---------------------------------------------------------------------- what may be compared


class Dated(Protocol):
    """A timing or a measure."""

    @property
    def backend(self) -> str: ...
    @property
    def sources(self) -> str: ...


Item = TypeVar("Item", bound=Dated)


def sources_of(item: Dated) -> str:
    """Return the digest of the backend's sources of a timing (without the experiment's own suffix)."""
    return item.sources.partition("-")[0]


def of_one_version(
    items: Sequence[Item],
    versions: Sequence[Version],
    here: bool,
    same: Callable[[Item], bool] = lambda item: False,
) -> list[Item]:
    """Return the items of one version of the code, which may be compared, in their order.

    Each backend keeps the version with most items, or with `here` the current code if it has any; of equal ones the version
    measured last (`versions` are in order of time). CPU and GPU stay together only if some run names the sources of both;
    else the one that was measured last stays. `same(item)`: its kernels are those of the current code.
    """

    def digest(item: Item) -> str:
        return digest_of(item.backend) if same(item) else sources_of(item)

    chosen, when = {}, {}
    for backend in BACKENDS:
        count = Counter(digest(item) for item in items if item.backend == backend)
        places = {getattr(version, backend): place for place, version in enumerate(versions)}
        now = digest_of(backend) if here and count else None
        if count:
            best = max(count, key=lambda key: (key == now, count[key], places.get(key, -1)))
            chosen[backend], when[backend] = best, (places.get(best, -1), count[best])
    if len(chosen) == len(BACKENDS) and not _side_by_side(chosen, versions):
        del chosen[min(BACKENDS, key=lambda backend: when[backend])]
    return [item for item in items if chosen.get(item.backend) == digest(item)]


def _side_by_side(digests: dict[str, str], versions: Sequence[Version]) -> bool:
    """True if the sources of both backends are of one version: named by one run, or with one digest."""
    wanted = tuple(digests[backend] for backend in BACKENDS)
    return len(set(wanted)) == 1 or any((version.cpu, version.gpu) == wanted for version in versions)
