"""A window of the demo on a display of its own, for tests: keys and mouse by xdotool, what it tells of itself."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self

import pytest

from softlab.app.command.scene_file import scene_toml
from softlab.model.scene.scene import Scene

TOOLS = Path(__file__).resolve().parents[1] / "tools"


# ---------------------------------------------------------------------- the window itself

PATIENCE = 120.0  # s for anything to happen: nothing here measures time, and a first compilation may be slow

needs_display = pytest.mark.skipif(
    not (shutil.which("Xvfb") and shutil.which("xdotool")),
    reason="Xvfb and xdotool are not installed (apt-get install xvfb xdotool)",
)


class Window:
    """The demo in a process of its own on a virtual screen, and what a user can do to it."""

    def __init__(self, folder: Path, display: str):
        scene = folder / "scene.toml"
        scene.write_text(
            "[grid]\nrows = 16\ncolumns = 16\npinned = 'top-corners'\n[springs]\n[damping]\n"
            "[gravity]\nenabled = false\n[method]\nintegrator = 'lab'\n"
        )
        self._start(
            folder,
            display,
            "from pathlib import Path; from softlab import load_scene; from softlab.app.window.viewer import run_demo;"
            f"run_demo([load_scene({str(scene)!r})], state_file=Path('state.json'))",
        )

    def _start(self, folder: Path, display: str, code: str) -> None:
        """Python's `code` in the folder, where it keeps state.json."""
        self.folder, self.state_file = folder, folder / "state.json"
        paths = os.pathsep.join([str(TOOLS), str(TOOLS.parents[1])])
        self.environment = os.environ | {"DISPLAY": display, "OMP_WAIT_POLICY": "passive", "PYTHONPATH": paths}
        self.environment.pop("NUMBA_ENABLE_CUDASIM", None)  # far too slow for a demo
        self.log = folder / "log.txt"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-c", code], cwd=folder, env=self.environment, stdout=log, stderr=subprocess.STDOUT
            )

    def __enter__(self) -> Self:
        """Once its first frames are drawn, with the pointer in it: the keyboard follows that where no window manager runs."""
        try:
            self.wait("the first frames", lambda state: state["frame"] > 3)
            self.xdotool("mousemove", 5, 700)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(timeout=10)

    def state(self) -> dict[str, Any]:
        return json.loads(self.state_file.read_text()) if self.state_file.exists() else {}

    def wait(self, what: str, condition: Callable[[dict[str, Any]], bool], compiling: bool = False) -> dict[str, Any]:
        """Until the state fulfils the condition, with `compiling` also while kernels compile; fails with the last state and
        the program's output."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            state = self.state()
            if state and (compiling or "compiling" not in state) and condition(state):
                return state
            if self.process.poll() is not None and not state.get("closed"):
                break
            time.sleep(0.05)
        output = self.log.read_text()[-3000:]
        pytest.fail(f"waited in vain for: {what}; state: {self.state()}; output: {output!r}")

    def frames(self, count: int = 6) -> dict[str, Any]:
        """Let some frames pass."""
        now = self.state()["frame"]
        return self.wait(f"{count} frames", lambda state: state["frame"] >= now + count)

    def settled(self) -> dict[str, Any]:
        """Wait until the view no longer glides: before that, a mass is not where the last state said it was."""
        before = self.state()
        for _ in range(200):
            now = self.frames()
            glide = [
                abs(new - old)
                for particle in now["masses"].keys() & before["masses"].keys()
                for new, old in zip(
                    now["masses"][particle]["window"], before["masses"][particle]["window"], strict=True
                )
            ]
            if glide and max(glide) < 0.5:  # pixels
                return now
            before = now
        pytest.fail(f"the view glides on and on; state: {now}")

    def grab(self, particle: int) -> tuple[int, int]:
        """Press the left button on a mass, once more if it was missed; the place in the window."""
        for _ in range(5):
            self.settled()
            x, y = self.mass(particle)
            self.xdotool("mousemove", x, y)
            self.xdotool("mousedown", 1)
            if self.frames(12)["selected"] == particle:
                return x, y
            self.xdotool("mouseup", 1)
        pytest.fail(f"mass {particle} is not to be had at {x}, {y}; state: {self.state()}")

    def let_go(self) -> None:
        """Release what a failed test may have left pressed."""
        for button in (1, 3):
            self.xdotool("mouseup", button)
        self.xdotool("keyup", "Return")

    def xdotool(self, *arguments: object) -> None:
        subprocess.run(["xdotool", *map(str, arguments)], env=self.environment, check=True, timeout=30)

    def key(self, name: str) -> None:
        self.xdotool("key", name)

    def mass(self, particle: int) -> tuple[int, int]:
        x, y = self.state()["masses"][str(particle)]["window"]
        return round(x), round(y)


class StillWindow(Window):
    """The demo's window with a scene that needs no solver, so that nothing has to be compiled."""

    def __init__(self, folder: Path, display: str, scene: Scene):
        (folder / "scene.toml").write_text(scene_toml(scene))
        self._start(
            folder,
            display,
            "from pathlib import Path; from softlab.app.window.demo import Demo\n"
            "from softlab.app.window.viewer import Viewer\n"
            "from fake_cloth import open_fake; from softlab.model.scene.scene import load_scene\n"
            "with Demo([load_scene('scene.toml')], open_world=open_fake) as demo:\n"
            "    Viewer(demo, Path('state.json'), None).run()\n",
        )


@pytest.fixture(scope="module")
def display() -> Iterator[str]:
    """A virtual screen on a free display number."""
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", "1", "-screen", "0", "1280x1000x24", "-nolisten", "tcp"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert server.stdout is not None
    number = server.stdout.readline().strip()
    if not number:
        server.wait(timeout=10)
        pytest.skip("Xvfb does not start here")
    yield f":{number}"
    server.terminate()
    server.wait(timeout=10)
