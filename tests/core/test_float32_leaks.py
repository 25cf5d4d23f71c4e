"""float32 stays float32: a constant that is no `real(...)` makes numba compute in float64, at half the speed. Python's own
arithmetic does not show that, so the formulas' sources are read; what comes of it on a GPU is looked at in test_ptx.py."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "model" / "formulas"


def inner_functions(tree: ast.Module) -> list[ast.FunctionDef]:
    """What factories make: functions within functions."""
    return [
        inner
        for outer in tree.body
        if isinstance(outer, ast.FunctionDef)
        for inner in ast.walk(outer)
        if isinstance(inner, ast.FunctionDef) and inner is not outer
    ]


def leaks(source: str) -> list[str]:
    """Constants and conversions in the functions of a topic that are not of its arithmetic."""
    found = []
    for function in inner_functions(ast.parse(source)):
        for node in ast.walk(function):
            if isinstance(node, ast.Constant) and isinstance(node.value, float):
                found.append(f"{function.name}: the constant {node.value}")
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div | ast.Pow):
                for side in (node.left, node.right):
                    if isinstance(side, ast.Constant):
                        found.append(f"{function.name}: the constant {side.value} in {ast.unparse(node)}")
            if isinstance(node, ast.Attribute) and node.attr in ("float64", "double"):
                found.append(f"{function.name}: {ast.unparse(node)}")
    return found


@pytest.mark.parametrize("file", sorted(FOLDER.rglob("*.py")), ids=lambda file: file.stem)
def test_formulas_hold_no_constant_of_float64(file: Path) -> None:
    assert leaks(file.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("line", ["x * 0.5", "1 / x", "x ** 2", "np.float64(x)", "x if x > 1e-9 else -x"])
def test_leaks_are_found(line: str) -> None:
    assert leaks(f"def make(real):\n    def inner(x):\n        return {line}\n    return inner")
    assert not leaks(
        "def make(real):\n    half = real(0.5)\n    def inner(x):\n        return x * half\n    return inner"
    )
