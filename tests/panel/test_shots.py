"""Pictures and clips of the window, from made-up frames: no window."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from softlab.app.window import shots as shots_module
from softlab.app.window.demo import Demo
from softlab.app.window.shots import Shots, free_path
from softlab.model.scene.scene import Scene


@pytest.fixture
def shots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Shots]:
    """In a folder of their own, of frames that are grey."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(shots_module, "read_pixels", lambda width, height: np.full((height, width, 4), 90, np.uint8))
    with Demo([Scene({"grid": {"rows": 2, "columns": 2}}, "a grid")], threads="1", math="exact") as demo:
        yield Shots(demo)


def test_a_picture_is_taken_once_and_none_is_replaced(shots: Shots, tmp_path: Path) -> None:
    shots.take(64, 48)
    assert not list(tmp_path.iterdir())
    for _ in range(2):
        shots.ask()
        shots.take(64, 48)
        shots.take(64, 48)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["softlab-a-grid-step0-2.png", "softlab-a-grid-step0.png"]
    assert shots.screenshot == tmp_path / names[0] and str(shots.screenshot) in shots.demo.message
    assert free_path(shots.demo, ".png").name == "softlab-a-grid-step0-3.png"


def test_a_clip_holds_the_frames_between_two_presses_and_ends_where_the_size_changes(
    shots: Shots, tmp_path: Path
) -> None:
    shots.toggle_clip()
    for _ in range(3):
        shots.take(65, 49)  # a clip's sides are even
    assert shots.recording
    shots.toggle_clip()
    clip = tmp_path / "softlab-a-grid-step0.mp4"
    assert not shots.recording and clip.stat().st_size > 500 and shots.demo.message == f"saved {clip}, 3 frames"
    shots.toggle_clip()
    shots.take(64, 48)
    shots.take(128, 48)
    assert not shots.recording and "size changed" in shots.demo.message and len(list(tmp_path.glob("*.mp4"))) == 2


def test_a_folder_that_cannot_be_written_to_is_told(shots: Shots, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shots_module, "free_path", lambda demo, suffix: Path("/nowhere/at/all") / f"x{suffix}")
    shots.toggle_clip()
    shots.ask()
    shots.take(64, 48)
    assert not shots.recording and "nowhere" in shots.demo.message
