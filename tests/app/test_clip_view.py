"""The view of pictures and clips of `softlab run`: size, rate, camera, text; a clip is drawn from one place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_offscreen import SCENE

from softlab.app.command.pictures import ClipView, check_rate, parse_camera, parse_size
from softlab.app.command.run import Request, run_scene
from softlab.app.driver import open_simulation
from softlab.app.output import bar
from softlab.app.output.offscreen import OffscreenRenderer
from softlab.app.output.video import Picture
from softlab.app.render.views import camera_of
from softlab.model.base.errors import InputError, SceneError
from softlab.model.scene.scene import Scene, load_scene

FALLING = SCENE.replace({"grid.pinned": "none", "method.dt": 0.01})


def test_a_camera_changes_the_picture_and_not_the_scene() -> None:
    scene = parse_camera(load_scene("jelly-drop"), "30,-5,2")
    assert scene.canonical() == load_scene("jelly-drop").canonical()
    assert Scene(scene.as_dict()).camera == scene.camera
    camera = camera_of(scene, 400, 200)
    assert np.isclose(camera.yaw, np.pi / 6) and np.isclose(camera.pitch, -np.pi / 36)
    camera.aim(scene.replace({"camera.target": [1.0, 2.0, 3.0]}).camera)
    assert np.isclose(camera.scale, 100) and camera.target.tolist() == [1, 2, 3]
    plane = camera_of(SCENE, 400, 200)
    plane.aim(SCENE.replace({"camera.target": [1.0, 2.0, 0.0], "camera.size": 4.0}).camera)
    assert plane.scale == 50 and plane.target.tolist() == [1, 2]


def test_bad_options_are_refused(tmp_path: Path) -> None:
    for text in ("12", "10x10", "640x", "ax4", "640x480x3", "640x99999999"):
        with pytest.raises(SceneError, match="--size"):
            parse_size(text)
    for text in ("3", "a,b", "1,2,3,4"):
        with pytest.raises(SceneError, match="--camera"):
            parse_camera(SCENE, text)
    for rate in (0.0, -1.0, 1e3, float("nan")):
        with pytest.raises(SceneError, match="--fps"):
            check_rate(rate, Path("clip.mp4"))
    for changes in ({"size": "64x48"}, {"fps": 30.0}, {"hud": False}):
        with pytest.raises(InputError, match="add --render"):
            run_scene(SCENE, Request(steps=1, **changes))
    assert parse_size("640x480") == (640, 480)


def test_a_clip_is_drawn_from_one_place_that_holds_every_frame(tmp_path: Path) -> None:
    """A sheet falls: it is as large in the last frame as in the first, and lower in the picture."""
    import imageio_ffmpeg

    with open_simulation(FALLING) as simulation:
        start = simulation.state()
        with ClipView(simulation, Picture(160, 120, fps=25, legend=False)) as view:
            assert (view.every, view.rate) == (4, 25)
            for _ in range(25):
                simulation.advance(view.every)
                view.observe(simulation)
        end, fitted = simulation.state(), view.fitted
    for state in (start, end):
        assert (np.abs(fitted.camera.to_window(state.position) - (80, 60)) < (80, 60)).all()
    with OffscreenRenderer(FALLING, 160, 120) as renderer:
        renderer.fix(fitted)
        renderer.fit(1e3 * end.position)
        assert renderer.camera is fitted.camera
    request = Request(steps=100, render=tmp_path / "clip.mp4", size="160x120", fps=25, hud=False)
    run_scene(FALLING, request, progress=False)
    clip = imageio_ffmpeg.read_frames(tmp_path / "clip.mp4")
    told = next(clip)
    assert told["size"] == (160, 120) and told["fps"] == 25
    images = [np.frombuffer(data, np.uint8).reshape(120, 160, 3).astype(int) for data in clip]
    rows = [np.flatnonzero((np.abs(image - image[0, 0]) > 25).any(axis=(1, 2))) for image in images]
    assert len(rows) == 26
    heights = [int(row.max() - row.min()) for row in (rows[0], rows[-1])]
    assert abs(heights[0] - heights[1]) <= 3 and rows[-1].min() > rows[0].min() + 10


def test_progress_is_told_where_there_is_no_terminal(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    now = [0.0]
    monkeypatch.setattr(bar, "monotonic", lambda: now[0])
    shown = bar.Bar()
    task = shown.add_task("drawing a.mp4", total=20)
    for done, seconds in ((1, 1.0), (5, 11.0), (6, 12.0), (9, 30.0)):
        now[0] = seconds
        shown.update(task, completed=done)
    assert capsys.readouterr().err.splitlines() == ["drawing a.mp4: 5 of 20", "drawing a.mp4: 9 of 20"]
    quiet = bar.Bar(show=False)
    now[0] = 100.0
    quiet.update(quiet.add_task("drawing", total=2), completed=1)
    assert capsys.readouterr().err == ""
