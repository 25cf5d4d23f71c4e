"""The packages and top-level files of a layer have an order: each imports only what ranks below it.

Imports inside functions and for types alone count. What breaks the order today stands in `import_exceptions.txt`, which only
shrinks: an entry that is no longer needed fails as a new violation does.
"""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXCEPTIONS = Path(__file__).with_name("import_exceptions.txt")
FAMILIES = "mass_spring xpbd shape_matching tetrahedra fluid"
BACKEND = ("core", "contact", FAMILIES, "world domains")
# Lowest first. Units of one line do not import each other.
ORDER = {
    "model": ("formulas", "base", "tables", "geometry", "assets", "scene", "core", "contact", FAMILIES, "world domains"),
    "cpu_backend": BACKEND,
    "gpu_backend": BACKEND,
    "app": ("auto_threads outcome shared", "driver", "render", "output", "command", "plan", "window"),
    "bench": (
        "store", "keys", "measure", "reference", "experiments", "stress", "peers cluster", "options",
        "advice_commands commands scale_commands sweep_commands",
    ),
    "plots": ("core", "figures", "findings", "draw"),
    "labbook": ("words", "tables", "claims answer", "facts rungs", "build", "film", "jobs", "commands"),
}  # fmt: skip
APART = {  # files that rank below the rest of their package: unit -> package, files
    "model": {
        "base": ("core", "clock digest disk_cache errors files kernel_cache memory pins tuples waiting"),
        "tables": ("scene", "parts words"),
    }
}


def unit_of(layer: str, parts: tuple[str, ...]) -> str:
    """The unit that a file or module belongs to; `parts` without the layer."""
    for unit, (package, files) in APART.get(layer, {}).items():
        if parts[0] == package and len(parts) > 1 and parts[1] in files.split():
            return unit
    return parts[0]


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
        here = unit_of(layer, parts[1:])
        for module in imports_of(file):
            there = unit_of(layer, tuple(module.split(".")[1:]))
            if here != there and ranks[there] >= ranks[here]:
                found.add(f"{'.'.join(parts)} -> {module}")
    return found


def exceptions() -> set[str]:
    lines = EXCEPTIONS.read_text(encoding="utf-8").splitlines()
    return {line for line in lines if line and not line.startswith("#")}


@pytest.mark.parametrize("layer", ORDER)
def test_every_unit_has_a_rank(layer):
    """Each package and top-level file stands in the order, and the order names nothing that is gone."""
    parts = [tuple(name.split(".")[1:]) for name in modules() if name.startswith(f"{layer}.")]
    assert {unit_of(layer, one) for one in parts} == set(ranks_of(layer))


@pytest.mark.parametrize("layer", ORDER)
def test_imports_go_down_the_order(layer):
    known = {line for line in exceptions() if line.startswith(f"{layer}.")}
    found = violations(layer)
    assert sorted(found - known) == [], "new imports against the order: move what both need down"
    assert sorted(known - found) == [], f"no longer needed: remove from {EXCEPTIONS.name}"


def test_the_exceptions_are_sorted_and_of_known_layers():
    lines = [line for line in EXCEPTIONS.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
    assert lines == sorted(set(lines))
    assert {line.partition(".")[0] for line in lines} <= set(ORDER)
