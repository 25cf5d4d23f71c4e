"""Position-based solvers on CPU threads that run one after the other: the same bits."""

from __future__ import annotations

import numba
import pytest
from xpbd_scenes import xpbd_scene
from xpbd_solve import end_state, same

from softlab.model.scene.scene import Scene

THREADS = [n for n in (1, 2, 3, 8) if n <= numba.config.NUMBA_NUM_THREADS]


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
