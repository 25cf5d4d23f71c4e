"""Errors name what was given in the words of whoever gave it: arguments in Python, options on the command line."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from softlab import cli
from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError, SoftlabError, in_python, on_command_line


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"backend": "cuda"}, "backend = 'cuda': must be one of cpu, gpu"),
        ({"precision": "float16"}, "precision = 'float16': must be one of"),
        ({"kernel": "quick"}, "kernel = 'quick': must be one of"),
        ({"threads": "3x"}, "threads = '3x': must be 1x"),
        ({"gpus": 2}, 'gpus = 2: applies to backend="gpu"; add it, or use ranks on CPUs'),
        ({"scene": "lab-grid", "dt": 1.0}, "or pass allow_unstable=True to run it anyway"),
    ],
)
def test_arguments_are_named(arguments: dict[str, object], said: str) -> None:
    from softlab.model.scene.scene import load_scene

    scene = load_scene(str(arguments.pop("scene", "lab-grid")))
    if "dt" in arguments:
        scene = scene.replace({"method.dt": arguments.pop("dt")})
    with pytest.raises(SceneError) as caught:
        open_simulation(scene, **arguments)  # type: ignore[arg-type]
    assert said in str(caught.value) and "--" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "arguments"),
    [
        ("use --kernel stages.", 'use kernel="stages".'),
        ("use --gpus 1", "use gpus=1"),
        ("--gpus and --ranks are mutually exclusive", "gpus and ranks are mutually exclusive"),
        ("--exchange-every = 0: must be", "exchange_every = 0: must be"),
        ("--set method.solver=xpbd, or leave it out", 'scene.replace({"method.solver": "xpbd"}), or leave it out'),
        ("--set method.order=1", 'scene.replace({"method.order": 1})'),
        ("--size = 3, --set grid.rows = 3", "--size = 3, --set grid.rows = 3"),  # no arguments of Python
        ("add --render FILE.png, --gpuslike", "add --render FILE.png, --gpuslike"),
    ],
)
def test_options_are_read_as_arguments(options: str, arguments: str) -> None:
    assert in_python(options) == arguments == str(SoftlabError(options))
    with on_command_line():
        assert str(SoftlabError(options)) == options
    assert str(SoftlabError(options)) == arguments  # also after a command


def test_the_command_line_names_options(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    for words, said in (
        ("run lab-grid --steps 0 --kernel quick", "--kernel = 'quick': must be one of"),
        ("run lab-grid --steps 0 --set method.dt=1", "or pass --allow-unstable"),
    ):
        monkeypatch.setattr(sys, "argv", ["softlab", *words.split()])
        with pytest.raises(SystemExit):
            cli.main()
        assert said in capsys.readouterr().err
