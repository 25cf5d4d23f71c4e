"""Work of the model that takes longer than a moment is shown, whether or not it reports; and a slow scene's steps are counted
from the first."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from rich.progress import Progress

from softlab.app.command import run, waiting
from softlab.app.command.waiting import waiting_shown
from softlab.app.driver import open_simulation
from softlab.model.base.waiting import report, waiting_watched, work
from softlab.model.scene.scene import Scene


@pytest.fixture
def bars(monkeypatch: pytest.MonkeyPatch) -> list[Progress]:
    """All bars that are made, none of them on a terminal."""
    made: list[Progress] = []

    class Bar(Progress):
        def __init__(self, columns: Any):
            super().__init__(*columns, disable=True)
            made.append(self)

    monkeypatch.setattr(waiting, "Bar", Bar)
    monkeypatch.setattr(waiting, "SHOWN_AFTER", 0.05)
    return made


def wait_for(bars: list[Progress], description: str) -> None:
    """Until a bar says so, for 10 s at most."""
    end = time.monotonic() + 10
    while not (bars and bars[-1].tasks and bars[-1].tasks[0].description == description):
        assert time.monotonic() < end, [task.description for bar in bars for task in bar.tasks]
        time.sleep(0.005)


def test_silent_work_gets_a_bar_of_the_innermost(bars: list[Progress]) -> None:
    with waiting_shown(), work("reading scan.toml"):
        with work("reading scan.ply"):
            wait_for(bars, "reading scan.ply")
            assert bars[0].tasks[0].total is None  # nobody knows for how long
        wait_for(bars, "reading scan.toml")
        report("distance field", 0.25)
        wait_for(bars, "distance field")
        assert bars[0].tasks[0].percentage == 25
    assert len(bars) == 1


def test_quick_work_gets_none_and_nested_commands_get_one(bars: list[Progress]) -> None:
    with waiting_shown(), waiting_shown():
        for _ in range(20):
            with work("quick"):
                pass
        time.sleep(0.15)
        assert not bars
        with work("slow"):
            wait_for(bars, "slow")
    assert len(bars) == 1


def test_no_bar_is_left_when_work_fails(bars: list[Progress]) -> None:
    with pytest.raises(KeyboardInterrupt), waiting_shown(), work("slow"):
        wait_for(bars, "slow")
        raise KeyboardInterrupt
    time.sleep(0.15)
    with work("nobody watches"):
        time.sleep(0.15)
    assert [task.description for bar in bars for task in bar.tasks] == ["slow"]


MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
ROLES = {
    "soft_body": {"particle_spacing": 0.2},
    "rigid_body": {"particle_spacing": 0.2},
    "tetrahedral_body": {"voxels": 3},
    "mesh": {"density": 0.2},
    "mesh_collider": {},
    "distance_field": {},
}


@pytest.mark.parametrize("kind", ROLES)
def test_every_role_of_a_mesh_says_what_it_does(kind: str, tmp_path: Path) -> None:
    """From the file to the first step."""
    file = tmp_path / "own.obj"
    file.write_text(f"# {uuid4()}\n{MESH}")  # what is made of the same bytes is kept
    tables: dict[str, Any] = {"own": {"kind": kind, "file": str(file)} | ROLES[kind]}
    if kind == "mesh":
        tables |= {"structural": {"stiffness": 10.0}, "method": {"solver": "xpbd"}}
    elif kind in ("mesh_collider", "distance_field"):
        tables["ball"] = {"kind": "rigid_body", "shape": {"name": "ball"}, "particle_spacing": 0.5}
    labels: list[str] = []
    with waiting_watched(lambda label, _fraction: labels.append(label)):
        open_simulation(Scene(tables)).close()
    assert {"reading own.obj", "preparing the solver"} <= set(labels)


def test_a_slow_scene_advances_in_short_batches() -> None:
    """So that its bar moves and Ctrl-C acts: 1024 steps at once took minutes."""
    batches: list[int] = []

    class Slow:
        backend, rank = "cpu", 0

        def advance(self, steps: int) -> None:
            batches.append(steps)
            time.sleep(0.05 * min(steps, 10))

        def slowest(self, seconds: float) -> float:
            return seconds

        def synchronize(self) -> None: ...
        def check(self) -> None: ...

    run._advance(Slow(), 20, [], False)  # type: ignore[arg-type]
    assert sum(batches) == 20 and batches[0] == 1 and max(batches) <= 6, batches
