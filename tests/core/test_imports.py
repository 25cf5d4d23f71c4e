"""Imports point one way, and nothing heavy is imported before it is used.

The packages and top-level files of a layer have an order, too, and families of solvers do not import each other.
"""

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LEVELS = {  # an import may only go to a lower level, or stay inside its own layer
    "softlab": 6,  # the command line and the public interface
    "labbook": 5,
    "plots": 4,
    "bench": 3,
    "app": 2,
    "cpu_backend": 1,
    "gpu_backend": 1,
    "model": 0,
}


FAMILIES = "mass_spring xpbd shape_matching tetrahedra fluid"
BACKEND = ("core", "contact", "position_based", FAMILIES, "world domains")
# Lowest first. Units of one line do not import each other.
ORDER = {
    "model": (
        "base", "formulas", "geometry", "assets", "tables", "particles", "scene", "core", "contact",
        "position_based", FAMILIES, "world domains",
    ),
    "cpu_backend": BACKEND,
    "gpu_backend": BACKEND,
    "app": (
        "auto_threads outcome presentation shared", "driver", "render", "output", "command", "families", "plan", "window",
    ),
    "bench": (
        "store", "keys", "measure", "reference", "experiments", "stress", "peers cluster", "options",
        "advice_commands declared_commands scale_commands sweep_commands",
    ),
    "plots": ("core", "figures", "findings", "draw"),
    "labbook": (
        "listings machines tables", "claims answer grid_tables", "facts rungs", "build", "film", "jobs", "commands",
    ),
}  # fmt: skip


def imported(file: Path) -> set[str]:
    """Layers of the lab that a file imports, inside functions too; "softlab" itself is what is public."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file.relative_to(ROOT)}:{node.lineno}: relative import; name the package"
            names.add(node.module or "")
    top = {name for name in names if name.split(".")[0] in LEVELS}
    assert all(name.split(".")[0] == "softlab" for name in top), f"{file.relative_to(ROOT)}: import softlab.<layer>"
    return {(f"{name}.".split(".")[1] or "softlab") for name in top} & set(LEVELS)


def sources() -> list[Path]:
    folders = [ROOT / name for name in LEVELS if (ROOT / name).is_dir()]
    return [file for folder in folders for file in sorted(folder.rglob("*.py"))]


@pytest.mark.parametrize("file", sources(), ids=lambda file: file.relative_to(ROOT).as_posix())
def test_imports_point_one_way(file):
    """softlab -> labbook -> plots -> bench -> app -> (cpu_backend | gpu_backend) -> model; the backends never meet."""
    here = file.relative_to(ROOT).parts[0]
    for package in imported(file) - {here}:
        assert LEVELS[package] < LEVELS[here], f"{file.relative_to(ROOT)} imports {package}"


def test_every_package_is_in_the_order():
    """A new package has to be given its place."""
    found = {folder.name for folder in ROOT.iterdir() if (folder / "__init__.py").exists()} - {"tests"}
    assert found <= set(LEVELS)


def ranks_of(layer: str) -> dict[str, int]:
    return {unit: rank for rank, tier in enumerate(ORDER[layer]) for unit in tier.split()}


@cache
def modules() -> dict[str, Path]:
    """Module, without `softlab.`, -> its file; packages under their own name."""
    found = {}
    for layer in ORDER:
        for file in sorted((ROOT / layer).rglob("*.py")):
            parts = file.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return found


def imports_of(file: Path) -> Iterator[str]:
    """The modules that a file imports from its own layer, without `softlab.`, wherever the statement stands."""
    layer = file.relative_to(ROOT).parts[0]
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            packages = [name for name in inner if name.removeprefix("softlab.") in modules()]
            names = packages + ([node.module] if len(packages) < len(inner) else [])
        for name in names:
            if name.startswith(f"softlab.{layer}."):
                yield name.removeprefix("softlab.")


def violations(layer: str) -> set[str]:
    """`layer: unit -> module` of every import that does not go down the order."""
    ranks, found = ranks_of(layer), set()
    for file in modules().values():
        parts = file.relative_to(ROOT).with_suffix("").parts
        if parts[0] != layer or parts[1] == "__init__":
            continue
        here = parts[1]
        for module in imports_of(file):
            there = module.split(".")[1]
            if here != there and ranks[there] >= ranks[here]:
                found.add(f"{'.'.join(parts)} -> {module}")
    return found


@pytest.mark.parametrize("layer", ORDER)
def test_every_unit_has_a_rank(layer):
    """Each package and top-level file stands in the order, and the order names nothing that is gone."""
    assert {name.split(".")[1] for name in modules() if name.startswith(f"{layer}.")} == set(ranks_of(layer))


@pytest.mark.parametrize("layer", ORDER)
def test_imports_go_down_the_order(layer):
    assert sorted(violations(layer)) == [], "imports against the order: move what both need down"


def test_there_is_no_circle():
    """Imports for types and inside functions counted."""
    modules = {".".join(("softlab", *file.relative_to(ROOT).with_suffix("").parts)): file for file in sources()}
    wanted: dict[str, set[str]] = {}
    for name, file in modules.items():
        found = set()
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        wanted[name] = found & set(modules) - {name}
    while leaves := {name for name, found in wanted.items() if not found & set(wanted)}:
        wanted = {name: found for name, found in wanted.items() if name not in leaves}
    while roots := set(wanted) - set().union(*wanted.values()):  # what only asks, and is asked by nobody
        wanted = {name: found for name, found in wanted.items() if name not in roots}
    assert not wanted, sorted(wanted)


def test_no_folder_holds_more_files_than_one_keeps_in_mind():
    """At most 25 of Python in a folder, beside the one that makes it a package."""
    folders = {file.parent for file in [*sources(), *(ROOT / "tests").rglob("*.py")]}
    counts = {
        str(f.relative_to(ROOT)): len([file for file in f.glob("*.py") if file.name != "__init__.py"]) for f in folders
    }
    assert {name: count for name, count in counts.items() if count > 25} == {}


@pytest.mark.parametrize(
    "statement",
    [
        "import softlab.cli",
        "import softlab.model.core.simulation",
        "from softlab import open_simulation",
        "import softlab.bench",
    ],
)
def test_no_heavy_import_at_the_door(statement):
    """`softlab --help` and test collection need no GPU, display or driver; the command line does not need the solvers."""
    heavy = (
        "pyglet",
        "matplotlib",
        "numba.cuda",
        "trimesh",
        *(["numba", "scipy"] if statement.endswith("cli") else []),
    )
    code = f"{statement}; import sys; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"


def test_a_whole_run_on_the_cpu_loads_no_cuda():
    """Not only the door: stepping on CPU threads leaves pyglet, matplotlib and numba.cuda alone."""
    code = (
        "import sys\n"
        "from softlab.app.driver import open_simulation\n"
        "from softlab.model.scene.scene import load_scene\n"
        "scene = load_scene('lab-curtain').replace({'grid.rows': 4, 'grid.columns': 4})\n"
        "with open_simulation(scene, kernel='stages', math='exact', precision='float64') as simulation:\n"
        "    simulation.advance(1)\n"
        "print([m for m in ('pyglet', 'matplotlib', 'numba.cuda', 'trimesh') if m in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"
