"""Without an optional component everything else works, and what needs it ends with status 3 and says what to install."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

BLOCK = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if any(name == part or name.startswith(part + ".") for part in {parts}):
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Missing())
"""
COMPONENTS = (
    "softlab.bench.cluster", "softlab.bench.peers", "softlab.labbook.film", "softlab.app.window.panel",
    "softlab.cpu_backend.domains", "softlab.gpu_backend.domains",
)  # fmt: skip
RUN = ("run", "lab-grid", "--set", "grid.rows=4", "--set", "grid.columns=4", "--steps", "2", "--kernel", "stages")
NEEDS = {  # component -> a command that needs it
    "softlab.bench.cluster": ("sweep", "--quick", "--cluster", "local"),
    "softlab.bench.peers": ("sweep", "--quick", "--peers"),
    "softlab.labbook.film": ("film", "--out", "film.mp4"),
}
OPENED = """
from softlab.app.shared import open_shared
from softlab.model.core.options import Options
from softlab.model.scene.scene import load_scene
open_shared(load_scene("lab-grid"), {backend!r}, Options(), "1x", {gpus}, {ranks}, None, "flags")
"""


def python(folder, code, parts):
    return subprocess.run(
        [sys.executable, "-c", BLOCK.format(parts=tuple(parts)) + code],
        cwd=folder, capture_output=True, text=True, timeout=300,
    )  # fmt: skip


def softlab(folder, arguments, parts):
    code = f"sys.argv = ['softlab', *{arguments!r}]\nfrom softlab.cli import main\nmain()"
    return python(folder, code, parts)


@pytest.mark.parametrize("arguments", [("--help",), ("plan", "lab-grid"), ("doctor",), RUN], ids=lambda a: a[0])
def test_commands_run_without_any_of_them(tmp_path, arguments):
    done = softlab(tmp_path, arguments, COMPONENTS)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("part", NEEDS)
def test_what_needs_a_missing_one_says_so(tmp_path, part):
    done = softlab(tmp_path, NEEDS[part], [part])
    assert done.returncode == 3, done.stdout + done.stderr
    assert part in done.stderr and "pip install" in done.stderr


@pytest.mark.parametrize(("part", "backend", "gpus", "ranks"), [
    ("softlab.cpu_backend.domains", "cpu", 1, 2), ("softlab.gpu_backend.domains", "gpu", 2, 1),
])  # fmt: skip
def test_a_shared_scene_needs_its_domains(tmp_path, part, backend, gpus, ranks):
    done = python(tmp_path, OPENED.format(backend=backend, gpus=gpus, ranks=ranks), [part])
    assert "BackendUnavailable" in done.stderr and f"needs {part}" in done.stderr and "pip install" in done.stderr


def test_a_window_without_its_panel_says_so(monkeypatch):
    from softlab.app.window import window_protocol

    monkeypatch.setattr(window_protocol, "PANEL", "softlab.app.window.no_panel:Panel")
    said: list[str] = []
    panel = window_protocol.panel_of(SimpleNamespace(demo=SimpleNamespace(say=said.append)))
    panel.toggle()
    assert not panel.open and "softlab.app.window.no_panel" in said[0] and "pip install" in said[0]
    asked = (
        "toggle",
        "key",
        "text",
        "moved",
        "pressed",
        "released",
        "scrolled",
        "lay_out",
        "draw",
        "widget_places",
        "close",
    )
    from softlab.app.window.panel.panel import Panel

    assert all(hasattr(panel, name) and hasattr(Panel, name) for name in (*asked, "width", "takes_keys"))


def test_nothing_imports_them():
    """Only their own files do, but for the peers, whose labels and ratios figures show."""
    root = Path(__file__).resolve().parents[2]
    found = []
    for part in COMPONENTS:
        if part == "softlab.bench.peers":
            continue
        folder = root / part.removeprefix("softlab.").replace(".", "/")
        for layer in ("model", "cpu_backend", "gpu_backend", "app", "bench", "plots", "labbook", "softlab"):
            for file in (root / layer).rglob("*.py"):
                text = file.read_text(encoding="utf-8")
                if folder not in file.parents and (f"from {part}" in text or f"import {part}" in text):
                    found.append(f"{file.relative_to(root)}: {part}")
    assert found == []
