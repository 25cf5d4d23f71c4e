"""The window while something is compiled: it draws, says so, takes no key that asks a world, and closes at once."""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from real_window import Window, display, needs_display  # noqa: F401

from softlab.app.window.compiling import Compiling
from softlab.app.window.demo_report import numbers_text

SLOW = (
    "import time; from pathlib import Path; from softlab.app.window import viewer, worlds\n"
    "from fake_cloth import FakeCloth, open_fake\n"
    "from softlab.model.scene.scene import load_scene\n"
    "FakeCloth.warm_up = lambda self, steps=1: time.sleep(600)\n"
    "worlds.Worlds.__init__.__kwdefaults__['open_world'] = open_fake\n"
    "viewer.run_demo([load_scene('cloth-hanging')], state_file=Path('state.json'))\n"
)


class SlowWindow(Window):
    """A window whose scene takes ten minutes to compile."""

    def __init__(self, folder: Path, screen: str):
        self._start(folder, screen, SLOW)

    def __enter__(self) -> SlowWindow:
        self.wait("a second of compiling", lambda state: state.get("compiling", 0) > 1, True)
        self.xdotool("mousemove", 5, 700)
        return self


@needs_display
@pytest.mark.display
def test_escape_closes_a_window_that_compiles(tmp_path: Path, display: str) -> None:  # noqa: F811
    with SlowWindow(tmp_path, display) as window:
        window.key("g")
        now = window.state()["compiling"]
        window.wait("going on after a key", lambda state: state.get("compiling", 0) > now + 1, True)
        window.key("Escape")
        assert window.process.wait(timeout=60) == 0, window.log.read_text()


def demo_of(backend: str, warm_up: Any) -> Any:
    return SimpleNamespace(backend=backend, generation=0, worlds=[SimpleNamespace(warm_up=warm_up)])


def until_done(compiling: Compiling) -> int:
    """Updates that returned True."""
    for number in range(2000):
        if not compiling.update():
            return number
        time.sleep(0.005)
    pytest.fail("it never ends")


def test_worlds_are_warmed_up_once_and_anew_when_they_become_others() -> None:
    calls: list[int] = []
    demo = demo_of("cpu", lambda: (time.sleep(0.05), calls.append(1)))
    compiling = Compiling(demo)
    assert compiling.due and until_done(compiling) > 0 and not compiling.due and not compiling.running
    assert not compiling.update() and calls == [1]
    demo.generation = 1
    assert compiling.due and until_done(compiling) > 0 and calls == [1, 1]


def test_a_gpu_is_warmed_up_on_the_windows_thread() -> None:
    calls: list[int] = []
    compiling = Compiling(demo_of("gpu", lambda: calls.append(1)))
    assert not compiling.update() and calls == [1]


def test_what_fails_is_raised_on_the_windows_thread() -> None:
    def fail() -> None:
        raise ValueError("no")

    for backend in ("cpu", "gpu"):
        with pytest.raises(ValueError, match="no"):
            until_done(Compiling(demo_of(backend, fail)))


def test_no_rate_is_shown_before_there_is_one() -> None:
    demo: Any = SimpleNamespace(world=SimpleNamespace(scene=None), compiling=12.3)
    text = numbers_text(demo, 1 / 60, 0.0)
    assert "compiling" in text and "12 s" in text and "frames/s" not in text and "physics" not in text
