"""The wheel: the files of the tree, and a lab that runs where it is installed, beside a user's own modules."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numba
import pytest
import typer

ROOT = Path(__file__).parents[2]
LAYERS = sorted({file.parent.name for file in ROOT.glob("*/__init__.py")} - {"softlab"})
DATA = (
    "model/catalogue/**/*.toml", "model/catalogue/meshes/*.obj", "bench/peers/**/*.cpp", "bench/peers/**/*.cu",
    "labbook/*.typ", "labbook/entries/*.typ", "labbook/pictures/*.webp", "labbook/data/*",
)  # fmt: skip


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built without isolation and network from a copy of the sources."""
    folder = tmp_path_factory.mktemp("wheel")
    for name in (*LAYERS, "softlab"):
        shutil.copytree(ROOT / name, folder / "tree" / name, ignore=shutil.ignore_patterns("__pycache__", "*.nb?"))
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy2(ROOT / name, folder / "tree" / name)
    words = ["wheel", "-q", "--no-deps", "--no-build-isolation", "--no-index", "-w", str(folder), str(folder / "tree")]
    done = subprocess.run([sys.executable, "-m", "pip", *words], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    (built,) = folder.glob("soft_body_lab-*.whl")
    return built


def test_it_holds_the_files_of_the_tree(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    files = [file for name in LAYERS for file in (ROOT / name).rglob("*.py")]
    files += [file for pattern in DATA for file in ROOT.glob(pattern) if file.is_file()]
    wanted = {f"softlab/{file.relative_to(ROOT).as_posix()}" for file in files}
    wanted |= {f"softlab/{file.name}" for file in (ROOT / "softlab").iterdir() if file.is_file()}
    assert held == wanted


def test_it_runs_where_it_is_installed(wheel: Path, tmp_path: Path) -> None:
    """In an environment of its own that borrows the libraries of this one, in a folder with modules of the layers' names."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(tmp_path / "venv")], check=True, timeout=120)
    python = tmp_path / "venv" / ("Scripts" if os.name == "nt" else "bin") / "python"
    query = "import sysconfig; print(sysconfig.get_path('purelib'))"
    target = Path(subprocess.run([python, "-c", query], check=True, capture_output=True, text=True).stdout.strip())
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(target)
    libraries = {str(Path(module.__file__).parents[1]) for module in (numba, typer)}  # their .pth files are not read
    (target / "libraries.pth").write_text("\n".join(sorted(libraries)) + "\n")
    user = tmp_path / "user"
    user.mkdir()
    for name in ("app", "model", "bench", "plots"):
        (user / f"{name}.py").write_text("WHOSE = 'the user'\n")
    (user / "tests").mkdir()
    (user / "script.py").write_text(
        "import app\nimport softlab\n"
        "with softlab.open_simulation('lab-grid') as simulation:\n    simulation.advance(3)\n"
        "print(app.WHOSE, simulation.step, softlab.__file__)\n"
    )
    plain = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    for words in (["-m", "softlab", "run", "lab-grid", "--steps", "3", "--no-judge"], ["script.py"]):
        done = subprocess.run(
            [python, *words], cwd=user, capture_output=True, text=True, timeout=300,
            env=plain | {"SOFTLAB_PLAIN_PYTHON": "1", "SOFTLAB_PLAIN_PYTHON_SECONDS": "60"},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "outcome" in done.stdout or done.stdout.split()[:3] == ["the", "user", "3"], done.stdout
    assert str(target) in done.stdout
