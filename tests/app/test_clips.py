"""Pictures and clips as files: frames, lengths, what is refused, what fails."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from test_offscreen import REST, SCENE

from softlab.app.driver import open_simulation
from softlab.app.output.offscreen import render_frame
from softlab.app.output.pictures import write_png
from softlab.app.output.video import Picture, VideoWriter, ffmpeg_path, reason, render, render_clip, true_rate
from softlab.model.base.errors import BackendUnavailable, Diverged, InputError
from softlab.model.base.files import replacing


def test_a_frame_becomes_a_png_and_nothing_else(tmp_path: Path) -> None:
    from PIL import Image

    path = render_frame(SCENE, REST, tmp_path / "frame.png", Picture(400, 300))
    picture = np.asarray(Image.open(path))
    assert picture.shape == (300, 400, 3) and len(np.unique(picture.reshape(-1, 3), axis=0)) > 20
    assert [file.name for file in tmp_path.iterdir()] == ["frame.png"]
    umask = os.umask(0)
    os.umask(umask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~umask


def test_a_simulation_becomes_a_clip(tmp_path: Path) -> None:
    import imageio_ffmpeg

    with open_simulation(SCENE) as simulation:
        path = render(simulation, tmp_path / "clip.mp4", steps=45, steps_per_frame=10, picture=Picture(321, 240))
        assert simulation.step == 45
        frame = render(simulation, tmp_path / "frame.png", picture=Picture(320, 240))
    assert imageio_ffmpeg.count_frames_and_secs(path)[0] == 6  # the start, after 10 20 30 40 steps, the end
    reader = imageio_ffmpeg.read_frames(path)
    assert next(reader)["size"] == (320, 240)  # an odd width is made even
    frames = [np.frombuffer(data, np.uint8).reshape(240, 320, 3) for data in reader]
    assert all((image < 200).any() for image in frames)
    assert np.abs(frames[-1].astype(int) - frames[0]).max() > 100  # it moves
    assert sorted(file.name for file in tmp_path.iterdir()) == ["clip.mp4", "frame.png"] and frame.exists()


def test_positions_become_a_frame_or_a_clip(tmp_path: Path) -> None:
    states = np.stack([REST, REST * 1.1, REST * 1.2])
    assert render(states, tmp_path / "a.mp4", scene=SCENE, picture=Picture(160, 120)).exists()
    assert render(REST, tmp_path / "a.png", scene=SCENE, picture=Picture(160, 120)).exists()
    with pytest.raises(InputError, match="scene"):
        render(REST, tmp_path / "b.png")
    with pytest.raises(InputError, match="frames, particles"):
        render(REST, tmp_path / "b.mp4", scene=SCENE)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_clip_that_diverges_leaves_nothing(tmp_path: Path) -> None:
    scene = SCENE.replace({"method.dt": 0.2})
    with open_simulation(scene, allow_unstable=True) as simulation, pytest.raises(Diverged):
        render_clip(simulation, tmp_path / "clip.mp4", 2000, picture=Picture(160, 120))
    assert not list(tmp_path.iterdir())


def test_bad_targets_are_refused_before_anything_is_drawn(tmp_path: Path) -> None:
    (tmp_path / "folder.png").mkdir()
    for path, words in (
        ("picture.gif", r"\.png or \.mp4"),
        ("missing/frame.png", "does not exist"),
        ("missing/clip.mp4", "does not exist"),
        ("folder.png", "is a folder"),
    ):
        with pytest.raises(InputError, match=words):
            render(REST, tmp_path / path, scene=SCENE)
    assert [file.name for file in tmp_path.iterdir()] == ["folder.png"]


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "frame.png"
    path.write_bytes(b"old")
    with pytest.raises(InputError, match="No space"), replacing(path) as temporary:
        temporary.write_bytes(b"half")
        raise OSError(28, "No space left on device")
    assert path.read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1
    write_png(path, np.zeros((4, 6, 4), np.uint8))
    assert path.read_bytes().startswith(b"\x89PNG")


def test_the_video_writer_refuses_what_it_cannot_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for size in ((321, 240), (320, 0)):
        with pytest.raises(InputError, match="even"):
            VideoWriter(tmp_path / "a.mp4", *size)
    with pytest.raises(InputError, match="shape"), VideoWriter(tmp_path / "a.mp4", 32, 32) as writer:
        writer.write(np.zeros((16, 32, 3), np.uint8))
    with pytest.raises(InputError, match="at least one frame"), VideoWriter(tmp_path / "a.mp4", 32, 32):
        pass
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "/nowhere/ffmpeg")
    with pytest.raises(BackendUnavailable, match="imageio-ffmpeg"), VideoWriter(tmp_path / "a.mp4", 32, 32):
        pass
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_an_input_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "ffmpeg"  # stands for an ffmpeg that ends early with a reason
    program.write_text(f"#!{sys.executable}\nimport sys\nsys.exit('write error: No space left on device')\n")
    program.chmod(0o755)
    assert ffmpeg_path()
    monkeypatch.setattr("softlab.app.output.video.ffmpeg_path", lambda: str(program))
    with (
        pytest.raises(InputError, match="no space left on the disk"),
        VideoWriter(tmp_path / "a.mp4", 640, 480) as writer,
    ):
        for _ in range(200):
            writer.write(np.zeros((480, 640, 3), np.uint8))
    assert [file.name for file in tmp_path.iterdir()] == ["ffmpeg"]


def test_what_ffmpeg_tells_is_told_without_its_addresses(tmp_path: Path) -> None:
    told = "[libx264 @ 0x55aa] broken\n[out#0/mp4 @ 0x56040f10e480] [error] Error closing file\n"
    assert reason(told, tmp_path / "a.mp4") == "Error closing file"
    assert reason("", tmp_path / "a.mp4") == "ffmpeg stopped"


def test_a_clip_lasts_as_long_as_what_it_shows(tmp_path: Path) -> None:
    """Eleven frames two steps of 0.01 s apart, the last one shown for as long as the others: 0.22 s."""
    import imageio_ffmpeg

    with VideoWriter(tmp_path / "a.mp4", 32, 32, true_rate(2, 0.01)) as writer:
        for _ in range(11):
            writer.write(np.zeros((32, 32, 3), np.uint8))
    found = next(imageio_ffmpeg.read_frames(tmp_path / "a.mp4"))
    assert found["duration"] == pytest.approx(0.22, abs=0.005) and found["fps"] == 50
