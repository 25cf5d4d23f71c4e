"""Kernels of many cases are compiled beforehand: once a kind, on other processes, and not again."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from softlab.bench.experiments.stability.experiment import QUICK, cases
from softlab.bench.measure import compile_ahead as ahead
from softlab.bench.measure.experiment import Summary, resume
from softlab.bench.store.database import Store
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene, load_scene


@dataclass(frozen=True)
class Fake:
    """Writes a file named after the process that opens it."""

    scene: Scene
    folder: Path
    precision: str = "float32"
    fails: bool = False
    backend: str = "cpu"
    sources: str = "s"

    @property
    def description(self) -> dict[str, Any]:
        return {"precision": self.precision, "math": "fast"}

    @contextmanager
    def open(self) -> Iterator[Any]:
        if self.fails:
            raise SceneError("a", 1, "cannot be opened")
        yield SimpleNamespace(warm_up=self.warm_up)

    def warm_up(self) -> None:
        name = f"{os.getpid()}-{self.scene.grid.rows}-{self.scene.method.dt}-{self.precision}"
        (self.folder / name).write_text("")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    kept = tmp_path / "kernels"
    kept.mkdir()
    monkeypatch.setattr(ahead, "folder", lambda: kept)
    return kept


def fakes(folder: Path) -> list[Fake]:
    """Three sizes x two precisions, each with two step sizes, which share their kernels; one of the sizes is huge."""
    grid = load_scene("lab-grid")
    scenes = [grid.replace({"grid.rows": rows, "method.dt": dt}) for rows in (2, 3, 2**20) for dt in (0.01, 0.001)]
    return [Fake(scene, folder, precision) for scene in scenes for precision in ("float32", "float64")]


def compile_ahead(cases: list[Fake], workers: int) -> int:
    """Return the number of kinds that were compiled."""
    return ahead.do_ahead(ahead.compilations(cases), False, workers)


def test_each_kind_is_compiled_once_elsewhere_and_known_afterwards(place: Path, tmp_path: Path) -> None:
    found = tmp_path / "found"
    found.mkdir()
    assert compile_ahead(fakes(found), workers=2) == 4
    made = sorted(file.name.split("-", 1) for file in found.iterdir())
    assert sorted(name for _, name in made) == [f"{rows}-0.01-{p}" for rows in (2, 3) for p in ("float32", "float64")]
    assert str(os.getpid()) not in {process for process, _ in made}
    assert compile_ahead(fakes(found), workers=2) == 0
    changed = [replace(fake, sources="other") for fake in fakes(found)]
    assert compile_ahead(changed, workers=2) == 4


def test_experiments_that_are_gathered_measure_nothing_and_share_a_pool(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two experiments with half of their kernels in common: one pool, each kind once, and none when they are measured."""
    pools: list[list[str]] = []
    monkeypatch.setattr(ahead, "core_count", lambda: 2)
    monkeypatch.setattr(ahead, "_done", lambda missing, *_: pools.append(list(missing)) or list(missing))
    measured: list[Fake] = []
    every = fakes(tmp_path)

    def measure(group: Sequence[Any], tell: Any) -> None:
        measured.extend(group)

    with Store(tmp_path / "store.sqlite") as store:

        def run(cases: list[Fake]) -> Summary:
            how: dict[str, Any] = {"progress": False, "command": "test"}
            return resume(store, Summary.begun(store, "test"), [cases], lambda case: False, measure, **how)

        with ahead.gathering(False):
            assert run(every[:6]).measured == run(every[2:]).measured == 0
        assert not measured and [len(pool) for pool in pools] == [4]
        run(every)
        assert measured == every and len(pools) == 1


def test_what_cannot_be_opened_is_left_to_the_measurement(place: Path, tmp_path: Path) -> None:
    assert compile_ahead([replace(fake, fails=True) for fake in fakes(tmp_path)], workers=2) == 4


def test_nothing_is_started_where_it_does_not_pay(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "_done", lambda *_: pytest.fail("started"))
    assert compile_ahead(fakes(tmp_path), workers=1) == 0
    assert compile_ahead(fakes(tmp_path)[:3], workers=8) == 0
    monkeypatch.setattr(ahead, "folder", lambda: None)
    assert compile_ahead(fakes(tmp_path), workers=8) == 0


def test_a_map_has_few_kinds() -> None:
    every = cases(QUICK, ["cpu"])
    kinds = {ahead.kind_of(case) for case in every}
    assert len(kinds) * 5 < len(every)
    assert len({kind[1] for kind in kinds}) == 2
