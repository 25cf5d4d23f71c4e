"""What machine code and measurements are keyed by: other content, another key; the same content, the same key."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from softlab.model.base import digest
from softlab.model.base.digest import ROOT, backend_sources, content_digest, source_digest

SCALE = 3.0


def made(factor: Any, extra: int = 0) -> Any:
    """A function of a closure, a global and a constant; its docstring, name and place in the file do not count."""

    def inner(x):
        return x * factor

    def outer(x):
        """Said in other words."""
        return inner(x) + SCALE + 1.0

    def other(x):
        return inner(x) + SCALE + 1.0

    def constant(x):
        return inner(x) + SCALE + 2.0

    def operation(x):
        return inner(x) - SCALE + 1.0

    return (outer, other, constant, operation)[extra]


def test_the_same_content_has_the_same_digest():
    assert content_digest(made(0.5)) == content_digest(made(0.5)) == content_digest(made(0.5, 1))


@pytest.mark.parametrize(
    "other",
    [made(0.25), made(np.float32(0.5)), made(0.5, 2), made(0.5, 3), made(1)],
    ids=["closure", "type", "constant", "operation", "integer"],
)
def test_other_content_has_another_digest(other):
    assert content_digest(other) != content_digest(made(0.5))


def test_a_global_counts(monkeypatch):
    before = content_digest(made(0.5))
    monkeypatch.setitem(globals(), "SCALE", 4.0)
    assert content_digest(made(0.5)) != before


def test_what_a_compiled_function_calls_counts_and_how_it_is_compiled():
    def calling(formula: Any, **options: Any) -> str:
        compiled = numba.njit(**options)(formula)
        return content_digest(lambda x: compiled(x))

    assert calling(made(0.5)) == calling(made(0.5))
    assert calling(made(0.5)) != calling(made(0.75))
    assert calling(made(0.5)) != calling(made(0.5), fastmath=True)


def test_a_function_that_calls_itself():
    def power(depth: int) -> Any:
        def repeated(n):
            return 1 if n < depth else 2 * repeated(n - 1)

        return repeated

    assert content_digest(power(1)) == content_digest(power(1)) != content_digest(power(2))


def test_a_digest_is_the_same_in_every_process():
    """Of a kernel with formulas, intrinsics of numba and of the lab: nothing in it depends on the process."""
    code = (
        "from softlab.cpu_backend.mass_spring.grid.kernels import make_advance; import numpy as np;"
        "print(make_advance(np.float32, 'fast', 'lab', frozenset({'springs', 'gravity'})).py_func.__name__)"
    )
    names = {
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT, env=environment
        ).stdout
        for environment in ({"PYTHONHASHSEED": "1"}, {"PYTHONHASHSEED": "2"})
    }
    assert len(names) == 1 and names.pop().startswith("team_advance_")


def test_every_part_of_a_kernel_is_known(monkeypatch):
    """No kernel refers to an object of which the digest knows nothing (it would be compiled in every process anew)."""
    from softlab.app.driver import open_simulation
    from softlab.gpu_backend.position_based.stages import make_xpbd_stages

    def unknown(self: Any, value: Any) -> Any:
        for piece in known(self, value):
            assert piece is not digest._UNKNOWN, f"{type(value)}: {value!r}"
            yield piece

    known = digest._Walk._of_object
    monkeypatch.setattr(digest._Walk, "_of_object", unknown)
    for scene in ("lab-grid", "cloth-wind", "cloth-self", "cloth-xpbd", "jelly-grid", "cloth-mesh", "rigid-stack"):
        with open_simulation(scene, threads=2):  # makes its kernels, and compiles nothing yet
            pass
    make_xpbd_stages(np.float32, "exact", frozenset(), 3)


@pytest.mark.parametrize("backend", ["cpu", "gpu"])
def test_touching_any_file_of_a_backend_changes_its_sources(tmp_path, monkeypatch, backend):
    """In a copy of the tree: every kernel, formula and record, also one in a folder of its own."""
    wanted = [f"{backend}_backend", "model"]
    for file in (file for name in wanted for file in (ROOT / name).rglob("*.py")):
        copy = tmp_path / file.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(file.read_bytes())
    inner = tmp_path / f"{backend}_backend" / "room" / "kernel.py"
    inner.parent.mkdir()
    inner.write_text("from softlab.model.geometry.shapes import Shape\n")
    monkeypatch.setattr(digest, "ROOT", tmp_path)
    places = backend_sources.__wrapped__(backend)
    files = [file for place in places for file in (place.rglob("*.py") if place.is_dir() else [place])]
    names = {str(file.relative_to(tmp_path)) for file in files}
    assert names >= {
        "model/core/parameters.py",
        "model/contact/substep_parameters.py",
        "model/geometry/shapes.py",
        "model/formulas/springs.py",
    }
    before = source_digest(*places)
    for file in files:
        text = file.read_bytes()
        file.write_bytes(text + b"\n")
        assert source_digest(*places) != before, file
        file.write_bytes(text)
    assert source_digest(*places) == before


def test_a_moved_file_is_another_source(tmp_path):
    def digest_of(*names: str) -> str:
        folder = tmp_path / "-".join(names).replace("/", "_")
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text("x = 1\n")
        return source_digest(Path(folder))

    assert len({digest_of("a.py"), digest_of("b.py"), digest_of("inner/a.py")}) == 3
