"""docs/scene-tutorial.md: its blocks are whole files and commands that run as they stand, in 60 lines."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

from softlab import cli
from softlab.app.driver import open_simulation
from softlab.app.window.panel.scene_list import scene_entries
from softlab.model.scene.scene import load_scene

PAGE = Path(__file__).resolve().parents[2] / "docs" / "scene-tutorial.md"
BLOCKS = re.findall(r"```(\w+)(?: title=\"([\w.-]+)\")?\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
FILES = {name: text for _, name, text in BLOCKS if name}
COMMANDS = [line for kind, _, text in BLOCKS if kind == "sh" for line in text.splitlines()]
COARSER = {  # seconds less of plain Python
    "jelly.toml": {"star.particle_spacing": 0.15},
    "pool.toml": {
        "water.rest_distance": 0.05, "wood.particle_spacing": 0.05, "method.substeps": 1, "method.iterations": 2,
    }
}  # fmt: skip
SCENES = [name for name in FILES if name.endswith(".toml")]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files of the page, the working folder."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_it_has_all_five_scenes_and_a_command_for_each_in_sixty_lines() -> None:
    assert SCENES == ["net.toml", "sail.toml", "jelly.toml", "pool.toml", "beam.toml"] and "sail.obj" in FILES
    assert {shlex.split(line)[2] for line in COMMANDS} == set(SCENES)
    assert sum(len(text.splitlines()) for _, _, text in BLOCKS) <= 60


@pytest.mark.parametrize("name", SCENES)
def test_each_scene_runs(name: str, folder: Path) -> None:
    scene = load_scene(name).replace(COARSER.get(name, {}))
    assert scene.gravity and [entry.name for entry in scene_entries()][: len(SCENES)] == sorted(SCENES)
    with open_simulation(scene, "cpu", threads="1", math="exact") as simulation:
        start = simulation.read("position").copy()
        simulation.advance(2)
        position = simulation.read("position")
    assert np.isfinite(position).all() and (position[:, 1] < start[:, 1]).any(), "something falls"


@pytest.mark.parametrize("line", [line for line in COMMANDS if " run " in line])
def test_each_command_is_understood(line: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With its options, but no steps and nothing drawn."""
    words = shlex.split(line)
    for option in ("--render", "--time", "--camera", "--size", "--fps", "--look"):  # a run of no steps has no clip
        if option in words:
            place = words.index(option)
            del words[place : place + 2]
    monkeypatch.setattr(sys, "argv", [*words, "--steps", "0", "--threads", "1", "--no-judge"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 0
