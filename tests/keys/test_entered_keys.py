"""Keys are entered with what is measured, and what was measured counts while its key stays the same."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from synthetic_store import CPU_RECORD

from softlab.bench.experiments import sweep
from softlab.bench.keys import enter
from softlab.bench.keys.ask import NO_KERNELS
from softlab.bench.keys.enter import KEY
from softlab.bench.keys.versions import MEASURING, version_of
from softlab.bench.measure import experiment as frame
from softlab.bench.measure.experiment import Summary, resume
from softlab.bench.store import versions
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration, measures
from softlab.bench.store.versions import digest_of
from softlab.model.base.digest import ROOT
from softlab.model.scene.scene import load_scene
from softlab.plots.core.older import without_older
from softlab.plots.core.read import load

OTHER = "0123456789abcdef"  # the digest of a checkout with other text


def case(digest: str) -> Any:
    description = configuration(load_scene("lab-grid").replace({"grid.rows": 8, "grid.columns": 8}), backend="cpu")
    return SimpleNamespace(description=description, sources=f"{digest}-1")


@pytest.fixture
def store(monkeypatch: pytest.MonkeyPatch) -> Store:
    for name in NO_KERNELS:  # of the processes that are asked for keys
        monkeypatch.delenv(name, raising=False)
    made = Store(":memory:")
    made.add_machine("m", "Made-up CPU, 2 cores", CPU_RECORD)
    monkeypatch.setattr(frame, "enter_machine", lambda store: "m")
    return made


def measured(store: Store, digest: str) -> Summary:
    """A sweep of one configuration, with a time that is made up."""

    def measure(group: Sequence[Any], tell: Any) -> None:
        for one in group:
            store.add_sample(summary.run, one.description, one.sources, 1e-3, 10)
            summary.measured += 1

    def held(one: Any) -> bool:
        return store.sample_count(one.description, summary.machine, one.sources) > 0

    summary = Summary.begun(store, "sweep")
    return resume(store, summary, [[case(digest)]], held, measure, progress=False, command="softlab sweep")


def text_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sources have another text from now on."""
    for module in (enter, versions):
        monkeypatch.setattr(module, "digest_of", lambda backend: OTHER)
    for module in ("softlab.bench.keys.carried", "softlab.plots.core.older"):
        monkeypatch.setattr(f"{module}.digest_of", lambda backend: OTHER)


def test_a_key_is_entered_once(store: Store) -> None:
    assert measured(store, digest_of("cpu")).measured == 1
    (found,) = measures(store, KEY)
    assert found.reason is not None and found.reason.split()[2] == version_of("sweep")
    assert measured(store, digest_of("cpu")).measured == 0
    assert len(store.query("SELECT 1 FROM measure WHERE name = ?", (KEY,))) == 1


def test_what_was_measured_counts_while_the_kernels_stay(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    measured(store, digest_of("cpu"))
    text_changes(monkeypatch)
    again = measured(store, OTHER)
    assert (again.measured, again.stored) == (0, 1)
    assert measured(store, OTHER).stored == 1, "and is not asked for again"
    results = load(store)
    assert without_older(results) is results


@pytest.mark.parametrize("what", ["formula", "version", "nothing known"])
def test_other_kernels_are_measured_anew(
    store: Store, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, what: str
) -> None:
    measured(store, digest_of("cpu"))
    text_changes(monkeypatch)
    old = load(store)
    assert without_older(old) is not old and not without_older(old).sources[0].timings
    assert "1 of its 1 numbers are older than this code" in old.sources[0].provenance
    if what == "formula":
        shutil.copytree(ROOT / "softlab", tmp_path / "softlab")
        shutil.copy(ROOT / "pyproject.toml", tmp_path)  # by which the package knows a checkout
        for name in ("app", "bench", "cpu_backend", "gpu_backend"):
            (tmp_path / name).symlink_to(ROOT / name)
        shutil.copytree(ROOT / "model", tmp_path / "model", ignore=shutil.ignore_patterns("__pycache__"))
        file = tmp_path / "model" / "formulas" / "springs.py"
        text = file.read_text(encoding="utf-8")
        assert "scale * dx" in text
        file.write_text(text.replace("scale * dx", "scale * dx * 2", 1), encoding="utf-8")
        monkeypatch.setattr(enter, "ROOT", tmp_path)
    elif what == "version":
        monkeypatch.setitem(MEASURING, "sweep", MEASURING["sweep"] + 1)
    else:
        store.connection.execute("DELETE FROM measure")
    assert measured(store, OTHER).measured == 1
    assert without_older(load(store)).sources[0].timings


def test_every_experiment_has_a_version() -> None:
    from softlab.bench.experiments.registry import experiments

    named = {one.name for one in experiments()}
    assert named <= set(MEASURING), named - set(MEASURING)
    assert sweep and {"sweep", "accuracy", "stability", "hard cases"} <= set(MEASURING)
