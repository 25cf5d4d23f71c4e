"""What `import softlab` offers: its names, their docstrings, and that nothing is imported or installed before it is used."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import softlab

ROOT = Path(__file__).parents[2]
NAMES = {  # a change of this list is a change of the public interface: docs/changelog.md
    "open_simulation", "Simulation", "State", "load_scene", "Scene", "judge", "distance", "converged", "scene_plan",
    "stability_limit", "SoftlabError", "SceneError", "InputError", "UnstableTimeStep", "BackendUnavailable", "Diverged",
    "Incomplete", "__version__",
}  # fmt: skip
METHODS = (
    "warm_up", "advance", "check", "rewind", "state", "load", "reset", "read", "read_clusters", "set", "poke", "energies",
    "add_body", "remove_body",
)  # fmt: skip


def run(code: str, folder: Path = ROOT) -> str:
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_names() -> None:
    assert set(softlab.__all__) == NAMES <= set(dir(softlab))
    assert all(getattr(softlab, name) is not None for name in NAMES)
    with pytest.raises(AttributeError, match="no attribute 'open_world'; public names: open_simulation"):
        softlab.open_world  # noqa: B018


def test_names_for_type_checkers_are_those_at_run_time() -> None:
    """Editors read the imports under TYPE_CHECKING, Python the table of modules."""
    tree = ast.parse(Path(str(softlab.__file__)).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    typed = {
        (alias.asname or alias.name): (f"{node.module}".removeprefix("softlab."), alias.name)
        for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }  # fmt: skip
    table = {}
    for name, place in softlab._MODULES.items():
        module, _, attribute = place.partition(":")
        table[name] = (module, attribute or name)
    assert typed == table and set(typed) == NAMES - {"__version__"}


def test_importing_it_is_light_and_leaves_the_process_alone() -> None:
    """No command line, no NumPy, no handler of a signal."""
    code = (
        "import signal, sys\nbefore = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)\nimport softlab\n"
        "assert before == (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM))\n"
        "print([m for m in ('typer', 'numpy', 'numba', 'pydantic', 'softlab.cli') if m in sys.modules])"
    )
    assert run(code).strip() == "[]"


def test_a_folder_with_modules_of_the_same_names_does_not_collide(tmp_path: Path) -> None:
    """The user's own app.py, model.py, bench.py ... stay the user's, and the lab finds its own."""
    for name in ("app", "model", "bench", "plots", "labbook", "cpu_backend", "gpu_backend"):
        (tmp_path / f"{name}.py").write_text(f"WHOSE = 'the user: {name}'\n")
    code = (
        "import app, model, bench, plots\nfrom softlab import load_scene, open_simulation, scene_plan\n"
        "scene = load_scene('rope')\n"
        "print(app.WHOSE, model.WHOSE, scene_plan(scene) is not None, open_simulation.__module__)"
    )
    assert run(code, tmp_path).strip() == "the user: app the user: model True softlab.app.driver"
    done = subprocess.run(
        [sys.executable, "-m", "softlab", "scenes"], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0 and "lab-grid" in done.stdout, done.stderr


FUNCTIONS = [name for name in sorted(NAMES) if inspect.isfunction(getattr(softlab, name))]


@pytest.mark.parametrize("name", [*FUNCTIONS, *(f"Simulation.{method}" for method in METHODS), "Scene.replace"])
def test_docstrings_have_the_sections_of_numpy(name: str) -> None:
    """A summary line that starts with a verb; every parameter, what is returned and what is raised."""
    function = softlab
    for part in name.split("."):
        function = getattr(function, part)
    text = inspect.getdoc(function) or ""
    assert re.match(r"[A-Z][a-z]+\b.*\.", text) and text.split()[0] not in ("Of", "What", "How", "Whether", "The")
    signature = inspect.signature(function)  # type: ignore[arg-type]
    wanted = [parameter for parameter in signature.parameters if parameter != "self"]
    section = re.search(r"^Parameters\n-+\n(.*?)(?=^\w[^\n]*\n---|\Z)", text, re.DOTALL | re.MULTILINE)
    listed = re.findall(r"^(\w[\w, ]*) :|^(\w+)$", section.group(1), re.MULTILINE) if section else []
    named = [each.strip() for pair in listed for each in (pair[0] or pair[1]).split(",")]
    assert named == wanted, f"{name}: documented {named}"
    returns = signature.return_annotation not in (None, "None")
    assert ("Returns\n-------" in text) == returns, name
