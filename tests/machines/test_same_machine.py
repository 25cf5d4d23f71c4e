"""The same on every machine: what decides a state is computed in an order of our own (model/geometry/arithmetic), so that
another processor, or what pretends to be one, starts every scene of the catalogue from the same bits."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from host_arrays import LEFT_OUT, arrays_of

from softlab.model.scene.reader import catalogue

ROOT = Path(__file__).resolve().parents[2]
TOOL = Path(__file__).parent / "host_arrays.py"
OTHER = {  # an old processor: OpenBLAS's kernels of 2008, NumPy and the C library without wide vectors and fused products
    "OPENBLAS_CORETYPE": "Nehalem",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F,-AVX2_Usable,-FMA_Usable",
}

# Modules of `model` that may use NumPy's `@`, dot, einsum, linalg, or its sines, exponentials and powers: why no start state
# and no step hangs on them.
EXCEPTIONS = {
    "assets/clusters.py": "rotations, goals and energies that are reported; kernels find rotations themselves",
    "shape_matching/energy.py": "reported energies and strains",
    "core/stability/springs.py": "reported energies and strains",
    "assets/skin.py": "drawn vertices and normals",
    "particles/tetrahedra/skin.py": "drawn vertices",
    "tetrahedra/material.py": "reported stretches, stresses and energies",
    "contact/attachments.py": "a reported energy",
    "geometry/anisotropy.py": "drawn ellipsoids",
    "geometry/voxels.py": "winding numbers, whole but for rounding, that are compared with a half",
    "geometry/tetrahedra/mesh.py": "a reported quality",
    "geometry/tetrahedra/voxels.py": "an inverse of whole numbers, rounded to halves",
    "contact/penetration.py": "reported gaps",
    "tables/colliders/surface_collider.py": "radians: one product",
    "geometry/measures.py": "radians: one product",
    "geometry/strokes.py": "radians: one product",
    "fluid/foam.py": "drawn points", "fluid/foam_walls.py": "drawn points",
    "world/meeting.py": "a search distance, which is wider than what counts",
    "contact/surface_parameters.py": "a search distance, which is wider than what counts",
    "geometry/formats/polygons.py": "a sum of angles, compared with half a turn, which it is far from",
    "geometry/mending/hull.py": "angles about an edge, rounded before they are ordered",
    "core/integrators.py": "the limit of a step size", "core/stability/limit.py": "the limit of a step size",
}  # fmt: skip
NAMES = {"dot", "einsum", "matmul", "tensordot", "inner", "vdot", "linalg", "cov"}
FUNCTIONS = {
    "sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh", "exp", "exp2", "expm1", "log",
    "log2", "log10", "log1p", "power", "float_power", "cbrt", "hypot", "radians",
}  # fmt: skip


def other_processor() -> dict[str, str]:
    """The environment in which NumPy uses none of its wider instruction sets, either."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    wider = [name for name in __cpu_dispatch__ if __cpu_features__.get(name)]
    return OTHER | ({"NPY_DISABLE_CPU_FEATURES": " ".join(wider)} if wider else {})


def hashes(scenes: list[str], cache: Path, **environment: str) -> dict[str, dict[str, str]]:
    """What the tool prints in a process of its own, whose bodies are made anew."""
    own = os.environ | {"SOFTLAB_PLAIN_PYTHON": "1", "XDG_CACHE_HOME": str(cache), "OMP_NUM_THREADS": "1"} | environment
    done = subprocess.run([sys.executable, str(TOOL), *scenes], env=own, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_whole_catalogue_starts_from_the_same_bits_on_another_processor(tmp_path: Path) -> None:
    scenes = [name for name in catalogue() if name not in LEFT_OUT]
    here = hashes(scenes, tmp_path / "here")
    there = hashes(scenes, tmp_path / "there", **other_processor())
    differ = {name: [where for where in one if one[where] != there[name].get(where)] for name, one in here.items()}
    assert sorted(here) == sorted(there) == sorted(scenes)
    assert all(len(one) > 10 for one in here.values()) and not any(differ.values()), differ


def test_the_tool_finds_arrays_wherever_they_lie() -> None:
    found = dict(arrays_of({"a": [np.zeros(1), (np.ones(2), "no", {"b": np.zeros(3)})]}))
    assert sorted(found) == ["[a][0]", "[a][1][0]", "[a][1][2][b]"]


def uses(source: str) -> list[tuple[int, str]]:
    """Lines of a module that hang on the processor, in their order: `@`, NAMES and FUNCTIONS of NumPy."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            found.append((node.lineno, "@"))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "np":
            if node.attr in NAMES | FUNCTIONS:
                found.append((node.lineno, f"np.{node.attr}"))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("scipy.linalg", "scipy.sparse.linalg")):
            found.append((node.lineno, str(node.module)))
    return sorted(found)


@pytest.mark.parametrize(
    "file",
    [file for file in sorted((ROOT / "model").rglob("*.py")) if "formulas" not in file.parts],
    ids=lambda file: file.relative_to(ROOT / "model").as_posix(),
)
def test_no_state_hangs_on_the_processor(file: Path) -> None:
    """`model/formulas` is compiled by both backends, whose bits other tests compare."""
    name = file.relative_to(ROOT / "model").as_posix()
    found = uses(file.read_text(encoding="utf-8"))
    if name in EXCEPTIONS:
        assert found, f"{name} needs no exception any more"
    else:
        assert not found, f"use model/geometry/arithmetic: {found}"


def test_what_is_forbidden_is_seen() -> None:
    source = "import numpy as np\na = b @ c\nd = np.linalg.inv(a)\ne = np.einsum('ij->i', a)\nf = np.sin(a)\ng = np.sqrt(a)\n"
    assert [line for line, _ in uses(source)] == [2, 3, 4, 5]
