"""Keys of whole configurations: a refactoring keeps them, a changed formula changes those of the kernels that use it."""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from softlab.bench.keys.ask import keys_at
from softlab.bench.keys.record import recorded
from softlab.bench.store.results import configuration
from softlab.model.base.digest import ROOT
from softlab.model.geometry.signed_distance import squared_distances
from softlab.model.scene.scene import load_scene

SCENES = {
    "grid": ("lab-grid", {}),
    "pushed": ("lab-grid", {"external.magnitude": 0.1}),  # the only one with random forces
    "cloth": ("cloth-hanging", {}),
    "bodies": ("jelly-drop", {}),
}
PACKAGES = ("app", "bench", "cpu_backend", "gpu_backend")


def descriptions(backend: str) -> dict[str, dict]:
    return {
        name: configuration(load_scene(scene).replace(changes), backend=backend)
        for name, (scene, changes) in SCENES.items()
    }


@pytest.fixture(params=["cpu", "gpu"])
def backend(request: pytest.FixtureRequest) -> str:
    if request.param == "gpu":
        pytest.importorskip("numba.cuda.dispatcher")
        pytest.importorskip("cuda.bindings.runtime")
    return request.param


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A checkout whose `model` may be changed."""
    shutil.copytree(ROOT / "softlab", tmp_path / "softlab")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)  # by which the package knows a checkout
    for name in PACKAGES:
        os.symlink(ROOT / name, tmp_path / name)
    shutil.copytree(ROOT / "model", tmp_path / "model", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def changed(tree: Path, file: str, old: str, new: str) -> None:
    text = (tree / file).read_text(encoding="utf-8")
    assert old in text
    (tree / file).write_text(text.replace(old, new), encoding="utf-8")


def test_a_constant_changes_the_keys_of_the_kernels_that_use_it_and_no_others(tree: Path, backend: str) -> None:
    before = keys_at(ROOT, descriptions(backend))
    assert set(before) == set(SCENES)
    changed(tree, "model/formulas/random.py", "0xD2511F53", "0xD2511F55")
    after = keys_at(tree, descriptions(backend))
    assert {name for name in SCENES if before[name][0] != after[name][0]} == {"pushed"}
    assert {name: arrays for name, (_, arrays) in before.items()} == {
        name: arrays for name, (_, arrays) in after.items()
    }


class Renamed(ast.NodeTransformer):
    """Other names for the locals of every function that holds no other, and no docstrings."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        if any(isinstance(inner, ast.FunctionDef | ast.Lambda) for inner in ast.walk(node) if inner is not node):
            self.generic_visit(node)
            return node
        stored = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        outer = {name for n in ast.walk(node) if isinstance(n, ast.Nonlocal | ast.Global) for name in n.names}
        parameters = {argument.arg for argument in ast.walk(node) if isinstance(argument, ast.arg)}
        names = {name: f"renamed_{k}" for k, name in enumerate(sorted(stored - outer - parameters))}
        for inner in ast.walk(node):
            if isinstance(inner, ast.Name):
                inner.id = names.get(inner.id, inner.id)
        if ast.get_docstring(node) and len(node.body) > 1:
            node.body = node.body[1:]
        return node


def test_a_rename_across_a_package_keeps_every_key(tree: Path, backend: str) -> None:
    """All locals of model/formulas have other names, its docstrings and layout are gone, and one module has moved."""
    for file in (tree / "model" / "formulas").rglob("*.py"):
        file.write_text(ast.unparse(Renamed().visit(ast.parse(file.read_text(encoding="utf-8")))), encoding="utf-8")
    for name in PACKAGES[2:]:
        (tree / name).unlink()
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    (tree / "model/formulas/lengths.py").rename(tree / "model/formulas/norms.py")
    for file in [path for name in ("model", *PACKAGES[2:]) for path in (tree / name).rglob("*.py")]:
        text = file.read_text(encoding="utf-8").replace(
            "softlab.model.formulas.lengths", "softlab.model.formulas.norms"
        )
        text = re.sub(r"(from softlab\.model\.formulas import .*\b)lengths(?! as)\b", r"\1norms as lengths", text)
        text = re.sub(r"(from softlab\.model\.formulas import .*\b)lengths as\b", r"\1norms as", text)
        file.write_text(text, encoding="utf-8")
    assert keys_at(tree, descriptions(backend)) == keys_at(ROOT, descriptions(backend))


def test_a_start_state_changes_the_key_of_the_arrays_alone() -> None:
    told = descriptions("cpu")["grid"]
    moved = json.loads(json.dumps(told))
    moved["scene"]["grid"]["origin"] = [0.25, 0.5]
    heavier = json.loads(json.dumps(told))
    heavier["scene"]["grid"]["mass"] *= 2
    keys = keys_at(ROOT, {"as it is": told, "moved": moved, "heavier": heavier})
    assert len({kernels for kernels, _ in keys.values()}) == 1
    assert keys["heavier"][1] != keys["as it is"][1]


def test_a_distance_field_is_sampled_while_launches_are_recorded() -> None:
    """It is built by a compiled function; without its values the key of the arrays was another one at every run."""
    triangle = np.array([[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]])
    with recorded() as calls:
        squared = squared_distances(triangle, np.array([1.0, 1.0, 0.0]), np.array([1, 1, 4]), 0.5)
    np.testing.assert_array_equal(squared, [[[0.0, 0.25, 1.0, 2.25]]])
    assert calls == []


def test_a_colouring_changes_the_key_of_the_arrays(tree: Path) -> None:
    told = {"mesh": configuration(load_scene("cloth-mesh"), backend="cpu")}
    before = keys_at(ROOT, told)["mesh"]
    changed(tree, "model/geometry/colouring.py", "seed: int = 0", "seed: int = 1")
    after = keys_at(tree, told)["mesh"]
    assert before[0] == after[0] and before[1] != after[1]
