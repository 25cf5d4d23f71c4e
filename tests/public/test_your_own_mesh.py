"""docs/your-own-mesh.md: its commands and scenes run as they stand, beside small meshes of the names that it uses."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from closed_meshes import Mesh, ball, box, without_some
from test_mesh import binary_stl, obj

from softlab import cli
from softlab.model.geometry.colouring import MAX_COLOURS
from softlab.model.geometry.topology import pinned_vertices
from softlab.model.scene.scene import load_scene

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "your-own-mesh.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w*)(?: title=\"([\w.-]+)\")?\n(.*?)```", TEXT, re.DOTALL)
SCENES = {name: text for _, name, text in BLOCKS if name}
COMMANDS = [line for kind, _, text in BLOCKS if kind == "sh" for line in text.splitlines()]
PRINTED = next(text for kind, _, text in BLOCKS if not kind)
NUMBER = re.compile(r"(?<![\w])[-+]?\d[\d.]*(?:e[-+]?\d+)?")


def scan() -> Mesh:
    """A ball with five holes, and two vertices that no triangle uses."""
    position, triangles = without_some(ball(0.03), 3, 40, 60, 90, 120)
    return np.concatenate([position, [[0, 0, 0], [0.01, 0, 0]]]), triangles


def ply(position: np.ndarray, triangles: np.ndarray) -> str:
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(position)}\nproperty float x\nproperty float y\nproperty float z\n"
    )
    head += f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [" ".join(map(str, row)) for row in position.tolist()]
    return head + "\n".join([*rows, *(" ".join(map(str, [3, *row])) for row in triangles.tolist())]) + "\n"


def garment() -> str:
    """A tube around y, open at both ends, its upper rim slanted: one vertex is the highest."""
    angle, rings = np.arange(8) * np.pi / 4, 5
    position = [
        (0.2 * np.cos(a), 0.1 * k + (0.08 * np.cos(a) if k == rings - 1 else 0.0), 0.2 * np.sin(a))
        for k in range(rings) for a in angle
    ]  # fmt: skip
    around = [(8 * k + j, 8 * k + (j + 1) % 8) for k in range(rings - 1) for j in range(8)]
    return obj(np.array(position), [face for a, b in around for face in ((a, a + 8, b + 8), (a, b + 8, b))])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the scenes of the page and meshes, the working folder."""
    for name, text in SCENES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    for name in ("scan.ply", "bunny.ply"):
        (tmp_path / name).write_text(ply(*scan()))
    (tmp_path / "part.stl").write_bytes(binary_stl(*box((40.0, 5.0, 5.0))))
    (tmp_path / "shirt.obj").write_text(garment())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 0


def test_the_page_has_a_scan_a_part_and_a_garment_and_runs_each() -> None:
    assert list(SCENES) == ["scan.toml", "part.toml", "shirt.toml"]
    assert [shlex.split(line)[2] for line in COMMANDS if " run " in line] == list(SCENES)
    assert {shlex.split(line)[1] for line in COMMANDS} == {"inspect", "run", "cook", "-c"}


@pytest.mark.parametrize("line", [line for line in COMMANDS if " run " in line])
def test_each_scene_runs(
    line: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """A step of it; nothing is drawn."""
    words = shlex.split(line)
    assert words[3:] == ["--time", "1", "--render", f"{Path(words[2]).stem}.png"]
    run([*words[:3], "--steps", "1", "--threads", "1", "--no-judge", "--json"], monkeypatch)
    printed = capsys.readouterr()
    assert json.loads(printed.out)["outcome"] == "ok"
    if "shirt" in line:
        assert 'pinned = "top" holds 1 of 40 vertices, the highest; list vertices to pin more' in printed.err


@pytest.mark.parametrize("line", [line for line in COMMANDS if " inspect " in line or " cook " in line])
def test_each_command_does_what_it_says(
    line: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    words = shlex.split(line, comments=True)
    run(words, monkeypatch)
    printed = capsys.readouterr().out
    if words[1] == "cook":
        assert (folder / words[3]).stat().st_size > 1000 and f"wrote {words[3]}" in printed
    elif "--json" in words:
        assert json.loads(printed)["vertices"] == 40
    else:
        assert ("scale" in line) == ("given by the scale: 0.001 m" in printed) and "fits" in printed


def test_the_output_on_the_page_is_what_inspect_prints_but_for_numbers(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    run(["softlab", "inspect", "bunny.ply"], monkeypatch)
    own = [line for line in capsys.readouterr().out.splitlines() if not line.startswith("does not fit")]
    assert [NUMBER.sub("#", line) for line in own] == [NUMBER.sub("#", line) for line in PRINTED.splitlines()]


def test_the_vertices_that_the_page_lists_are_pinned(folder: Path) -> None:
    line = next(line for line in COMMANDS if line.startswith("python"))
    done = subprocess.run(
        [sys.executable, *shlex.split(line)[1:]], capture_output=True, text=True, check=True, timeout=120,
        env={"PYTHONPATH": str(ROOT), "PATH": ""},
    )  # fmt: skip
    listed = json.loads(done.stdout)
    assert len(listed) == 3  # of the slanted rim
    scene = load_scene("shirt.toml").replace({"mesh.pinned": listed})
    assert scene.mesh is not None and pinned_vertices(scene.mesh).tolist() == listed


def test_messages_in_the_table_of_remedies_are_the_labs() -> None:
    """All of a message but its numbers and names."""
    files = [file for room in ("app", "model") for file in (ROOT / room).rglob("*.py")]
    sources = "".join(file.read_text(encoding="utf-8") for file in files)
    sources = re.sub(r"\"\s*\n\s*f?\"", "", sources)
    table = TEXT.partition("## If it does not work")[2]
    messages = re.findall(r"^\| `([^`]+)`", table, re.MULTILINE)
    assert len(messages) > 5 and f"at most {MAX_COLOURS} can" in table
    for message in messages:
        for part in re.split(r"\bN\b|\d[\d.]*|\.\.\.", message):
            assert part.strip() in sources, message
