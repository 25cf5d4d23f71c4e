"""float32 stays float32: an integer literal or a conversion makes numba compute in float64, at half the speed. Python's own
arithmetic does not show that, so variants refuse such formulas; what becomes of them on a GPU is read in test_ptx.py."""

from __future__ import annotations

from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import FunctionType, ModuleType

import pytest

from softlab.model.base.variant import FEATURES, is_formula, specialised_tree

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "model" / "formulas").rglob("*.py"))


def check(module: ModuleType) -> int:
    """Raise TypeError if a formula of a module leaks; return their number."""
    formulas = [value for value in vars(module).values() if isinstance(value, FunctionType) and is_formula(value)]
    for formula in formulas:
        specialised_tree(formula, frozenset(dict.fromkeys(FEATURES, False).items()), False)
    return len(formulas)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_formulas_hold_no_constant_of_float64(file: Path) -> None:
    name = "softlab." + ".".join(file.relative_to(ROOT).with_suffix("").parts)
    assert check(import_module(name.removesuffix(".__init__"))) or file.name == "__init__.py"


@pytest.mark.parametrize(
    ("line", "leaks"),
    [
        ("x * 2", True), ("1 / x", True), ("x ** 2", True), ("1 - x", True), ("x / -2", True), ("float(1) * x", True),
        ("np.float64(x)", True), ("2.0 * x", False), ("real(2) * x", False), ("np.float32(x)", False),
    ],
)  # fmt: skip
def test_leaks_are_found(line: str, leaks: bool, tmp_path: Path) -> None:
    file = tmp_path / "leaking.py"
    file.write_text(
        "import numpy as np\nfrom softlab.model.base.variant import formula, real\n\n\n"
        f"@formula\ndef leaking(x):\n    return {line}\n"
    )
    specification = spec_from_file_location("leaking", file)
    assert specification and specification.loader
    module = module_from_spec(specification)
    specification.loader.exec_module(module)
    if leaks:
        with pytest.raises(TypeError, match=r"leaking\.py:7: `.*`( is a float64|: an integer literal)"):
            check(module)
    else:
        assert check(module) == 1
