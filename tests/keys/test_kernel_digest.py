"""Kernel digests: names, places and Python versions do not count, what is computed does."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from softlab.bench.keys.kernel_digest import KernelDigests, SourceUnknown
from softlab.model.base.digest import ROOT
from softlab.model.formulas import springs

KERNEL = '''
SCALE = 3.0

def make(real, wide):
    """A factory."""
    half = real(0.5)

    def pull(distance: float, rest: float = 1.0) -> float:
        """The pull of a spring."""
        return half * (distance - rest)

    def kernel(points, out):
        """Writes out."""
        for i in range(points.size):
            total = pull(points[i], rest=2.0) * SCALE
            if wide:
                total = total + 1.0
            out[i] = total

    return kernel
'''
RENAMED = """
FACTOR = 3.0


def build(number, broad):
    middle = number(0.5)

    def attraction(d, r=1.0):
        return middle * (
            d - r  # shorter is nearer
        )

    def loop(places, result):
        for k in range(places.size):
            s = attraction(places[k], r=2.0) * FACTOR
            if broad:
                s = s + 1.0
            result[k] = s

    return loop
"""
COUNT = iter(range(1000))


def made(folder: Path, text: str, factory: str = "make", wide: bool = False, real: Any = float) -> Any:
    """The kernel of a module with this text, whose name no other module has."""
    path = folder / f"module_{next(COUNT)}.py"
    path.write_text(textwrap.dedent(text), encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, factory)(real, wide)


def digest(kernel: Any) -> str:
    return KernelDigests().of(kernel)


@pytest.mark.parametrize("wide", [False, True])
def test_names_and_layout_do_not_count(tmp_path: Path, wide: bool) -> None:
    assert digest(made(tmp_path, KERNEL, wide=wide)) == digest(made(tmp_path, RENAMED, "build", wide))


@pytest.mark.parametrize(
    "old,new",
    [
        ("real(0.5)", "real(0.25)"),
        ("distance - rest", "rest - distance"),
        ("SCALE = 3.0", "SCALE = 4.0"),
        ("rest=2.0", "rest=1.0"),
        ("rest: float = 1.0", "rest: float = 1.5"),
        ("range(points.size)", "range(1, points.size)"),
        ("out[i]", "out[0]"),
        ("points.size", "points.ndim"),
    ],
)
def test_what_is_computed_counts(tmp_path: Path, old: str, new: str) -> None:
    assert old in KERNEL
    assert digest(made(tmp_path, KERNEL)) != digest(made(tmp_path, KERNEL.replace(old, new)))


def test_a_branch_that_a_constant_closes_does_not_count(tmp_path: Path) -> None:
    other = KERNEL.replace("total + 1.0", "total + 2.0")
    assert digest(made(tmp_path, KERNEL)) == digest(made(tmp_path, other))
    assert digest(made(tmp_path, KERNEL, wide=True)) != digest(made(tmp_path, other, wide=True))
    assert digest(made(tmp_path, KERNEL, wide=True)) != digest(made(tmp_path, KERNEL))


def test_a_default_behind_or_counts(tmp_path: Path) -> None:
    text = "def make(real, wide):\n    return lambda x: x or 5\n"
    texts = [text, text.replace("5", "7"), text.replace(" or 5", ""), text.replace("5", "wide"), text.replace("5", "0")]
    found = [digest(made(tmp_path, one)) for one in texts]
    assert len(set(found[:3] + found[4:])) == 4
    assert found[3] == found[2], "`or False` decides nothing"


def test_exchanged_names_count(tmp_path: Path) -> None:
    """Two parameters that change places are another function, though each name is still there."""
    other = KERNEL.replace(
        "def pull(distance: float, rest: float = 1.0)", "def pull(rest: float, distance: float = 1.0)"
    )
    assert digest(made(tmp_path, KERNEL.replace("rest=2.0", "2.0"))) != digest(
        made(tmp_path, other.replace("rest=2.0", "2.0"))
    )


def test_precision_and_options_count(tmp_path: Path) -> None:
    plain = made(tmp_path, KERNEL, real=np.float32)
    assert digest(plain) != digest(made(tmp_path, KERNEL, real=np.float64))
    assert digest(numba.njit(plain)) != digest(numba.njit(fastmath=True)(plain))
    assert digest(numba.njit(plain)) == digest(numba.njit(nogil=True)(plain)), "how it is called is no part of it"


def test_a_function_that_calls_itself(tmp_path: Path) -> None:
    text = """
    def make(real, wide):
        def repeated(n):
            return 1 if n < 2 else 2 * repeated(n - 1)
        return repeated
    """
    assert digest(made(tmp_path, text)) == digest(made(tmp_path, text.replace("repeated", "again")))
    assert digest(made(tmp_path, text)) != digest(made(tmp_path, text.replace("2 * ", "3 * ")))


def test_what_has_no_source_is_refused(tmp_path: Path) -> None:
    space: dict[str, Any] = {}
    exec("def kernel(x):\n    return x\n", space)
    with pytest.raises(SourceUnknown, match="kernel"):
        digest(space["kernel"])
    text = "class Own: ...\ndef make(real, wide):\n    found = Own()\n    return lambda x: found\n"
    with pytest.raises(TypeError, match="Own"):
        digest(made(tmp_path, text))


def test_cuda_formulas_in_exact_math_differ_from_fast_ones() -> None:
    """Every product of an exact one is rounded: the compiled copy is found, and its products count."""
    pytest.importorskip("numba.cuda")
    from softlab.gpu_backend.core.formulas import device_formulas

    exact, fast = (device_formulas(springs, np.float32, math).spring_acceleration_2d for math in ("exact", "fast"))
    assert digest(exact) != digest(fast)


def other_pythons() -> list[Path]:
    """Interpreters of other versions beside this one's."""
    here = Path(sys.base_prefix)
    found = {path.parent.parent: path for path in sorted(here.parent.glob("*3.1[1-9]*/bin/python3"))}
    return [path for prefix, path in found.items() if prefix != here]


SCRIPT = """
import sys
sys.path[:0] = sys.argv[1:3]
from softlab.bench.keys.kernel_digest import KernelDigests
import formula
print(KernelDigests().of(formula.make(float, True)), KernelDigests().of(formula.more))
"""
MORE = """
def more(values, *rest, scale=2):
    total: float = 0.0
    found = [value * scale for value in values if value > 0]
    try:
        for k, value in enumerate(found):
            total += value if k % 2 else -value
    except ValueError as error:
        raise RuntimeError("no number") from error
    return total, {k: v for k, v in zip(found, rest)}, (lambda x: x ** 2)(total), f"{total:.2f} of {scale!r}"
"""


def test_every_python_computes_the_same_digest(tmp_path: Path) -> None:
    (tmp_path / "formula.py").write_text(KERNEL + MORE, encoding="utf-8")
    told = {
        python: subprocess.run(
            [str(python), "-c", SCRIPT, str(ROOT), str(tmp_path)], check=True, capture_output=True, text=True
        ).stdout
        for python in [Path(sys.executable), *other_pythons()]
    }
    if len(told) == 1:
        pytest.skip("no other version of Python lies beside this one")
    assert len(set(told.values())) == 1, told
