"""The position-based solvers on CPU threads: one answer from both kernels, for every number of threads and every batch of
steps."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from xpbd_scenes import xpbd_scene
from xpbd_solve import end_state, same

from softlab.model.core.build import build
from softlab.model.scene.scene import Scene

SHEETS = [(1, 1), (1, 7), (7, 1), (2, 2), (3, 5), (7, 6), (17, 35)]  # the last: of several vectors, and not whole ones
THREADS = [n for n in (1, 2, 3, 8) if n <= numba.config.NUMBA_NUM_THREADS]


@pytest.mark.parametrize(
    ("name", "ordering", "precision", "sheets"),
    [
        ("everything", "gauss-seidel", "float64", [(7, 6), (17, 35)]),  # its loads lie in row 6
        ("everything", "jacobi", "float64", [(7, 6), (17, 35)]),
        ("damped", "jacobi", "float64", [(7, 6), (17, 35)]),  # dampers look at what neighbours' predictions replace
        ("net", "gauss-seidel", "float32", SHEETS),
        ("alternating", "averaged-jacobi", "float64", SHEETS),
    ],
)
def test_fused_gives_the_bits_of_the_stages(
    name: str, ordering: str, precision: str, sheets: list[tuple[int, int]]
) -> None:
    """For every number of threads, in one go and in several."""
    for rows, columns in sheets:
        pins = {} if name == "everything" else {"pinned": "top-corners"}
        scene = xpbd_scene(name, ordering, rows=rows, columns=columns, **pins)
        expected = end_state(scene, kernel="stages", precision=precision, threads=2)
        moved = np.abs(expected.position - build(scene).position).max()
        assert np.isfinite(expected.position).all() and (moved > 1e-5 or rows * columns == 1)
        for threads in THREADS:
            assert same(end_state(scene, threads=threads, precision=precision), expected), (rows, columns, threads)
        batched = end_state(scene, (1, 0, 2, 1), threads=2, precision=precision)
        assert same(batched, expected), (rows, columns, "batches")


@pytest.mark.parametrize("ordering", ["gauss-seidel", "jacobi"])
def test_members_that_run_one_after_the_other_give_the_same_bits(
    ordering: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a threading layer that promises no more; with wind, whose walk looks at the neighbours' rows."""
    air = xpbd_scene("air", ordering, rows=17, columns=19, iterations=2).as_dict()
    scene = Scene({name: part for name, part in air.items() if name not in ("shear", "bending", "external")})
    expected = end_state(scene, kernel="stages", threads=2)
    for threads in THREADS:
        assert same(end_state(scene, threads=threads), expected), threads
    set_num_threads = numba.set_num_threads
    monkeypatch.setattr(numba, "set_num_threads", lambda count: set_num_threads(1))
    assert same(end_state(scene, threads=max(THREADS)), expected)
