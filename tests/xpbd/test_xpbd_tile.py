"""Tiles hold everything that their own masses depend on, found anew by following every constraint; choices of kernels."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.gpu_backend.xpbd.choice import (
    Choice,
    best_tiled,
    default_choice,
    default_xpbd_kernel,
    estimate,
    xpbd_kernel,
)
from softlab.gpu_backend.xpbd.tile import SheetTile, dependencies, span
from softlab.model.base.errors import SceneError
from softlab.model.position_based.plan import colour_order, families, xpbd_parts
from softlab.model.scene.scene import Scene

KINDS = ("structural", "shear", "bending")
H200 = (132, 227 << 10)


def influences(parts: frozenset[str], rows: int, columns: int, iterations: int) -> np.ndarray:
    """(masses, masses) bool: whether the second's position before the iterations has a say in the first's after them."""
    number = np.arange(rows * columns).reshape(rows, columns)
    found = np.eye(rows * columns, dtype=bool)
    gauss_seidel = "gauss-seidel" in parts
    order = colour_order(parts) if gauss_seidel else [(family, -1) for family in families(parts)]
    for _ in range(iterations):
        old = found.copy()
        for family, colour in order:
            for i in range(rows - family.rows):
                for j in range(columns - abs(family.columns)):
                    place = i // family.rows if family.rows else j // family.columns
                    if gauss_seidel and place % 2 != colour:
                        continue
                    if family.columns < 0:
                        a, b = number[i, j + 1], number[i + 1, j]
                    else:
                        a, b = number[i, j], number[i + family.rows, j + family.columns]
                    if gauss_seidel:
                        found[a] = found[b] = found[a] | found[b]
                    else:
                        found[a] |= old[b]
                        found[b] |= old[a]
    return found


@pytest.mark.parametrize("iterations", [1, 2])
@pytest.mark.parametrize("kinds", [KINDS, KINDS[:2], KINDS[:1], KINDS[2:]], ids="-".join)
@pytest.mark.parametrize("ordering", ["gauss-seidel", "jacobi"])
def test_a_tile_holds_all_that_its_masses_depend_on(ordering: str, kinds: tuple[str, ...], iterations: int) -> None:
    parts = frozenset((*kinds, ordering))
    rows, columns = (span(parts, along_rows, 4, iterations) for along_rows in (True, False))
    tile = SheetTile(rows, columns, 32)
    height, width = tile.rows.size + 10, tile.columns.size + 10  # so that no edge of the sheet helps
    index = [s.start + s.owned * (-(-(s.before - s.start) // s.owned)) for s in (rows, columns)]  # a tile well inside
    found = influences(parts, height, width, iterations).reshape(height, width, height, width)
    own = found[index[0] : index[0] + 4, index[1] : index[1] + 4].any(axis=(0, 1))
    for along_rows, s, first in ((True, rows, index[0]), (False, columns, index[1])):
        used = np.flatnonzero(own.any(axis=1 if along_rows else 0))
        assert first - s.before <= used[0] and used[-1] < first - s.before + s.size
        expected = dependencies(parts, along_rows, first, first + 4, iterations)
        assert expected[0] <= used[0] and used[-1] < expected[1]
        assert used[0] - expected[0] <= 1 and expected[1] - 1 - used[-1] <= 1  # and hardly more


def test_the_halo_of_all_twelve_families() -> None:
    """As the module says: 4 rows and 8 columns, from a multiple of 4 plus 2 on."""
    parts = frozenset((*KINDS, "gauss-seidel"))
    assert dependencies(parts, True, 2, 18) == (-2, 22) and dependencies(parts, False, 2, 18) == (-6, 26)
    assert dependencies(parts, True, 0, 16) == (-6, 22)
    rows, columns = span(parts, True, 16), span(parts, False, 16)
    assert (rows.size, rows.before, rows.start, rows.phase) == (24, 4, -2, 2)
    assert (columns.size, columns.before, columns.start) == (32, 8, -2)


@pytest.mark.parametrize("masses", [1, 2, 13, 14, 15, 30, 31, 47])
def test_tiles_own_every_mass_once(masses: int) -> None:
    for parts in (frozenset((*KINDS, "gauss-seidel")), frozenset(("structural", "jacobi"))):
        s = span(parts, True, 16)
        owned = [s.start + t * s.owned + n for t in range(s.count(masses)) for n in range(s.owned)]
        assert sorted(set(owned)) == owned and set(range(masses)) <= set(owned)
        assert s.start + (s.count(masses) - 1) * s.owned < masses  # none owns nothing


def scene(n: int, ordering: str = "gauss-seidel") -> Scene:
    return Scene(
        {
            "cloth": {"rows": n, "columns": n, "spacing": 0.1},
            **{kind: {"stiffness": 100.0} for kind in KINDS},
            "method": {"solver": "xpbd", "iterations": 10, "ordering": ordering},
        }
    )


@pytest.mark.parametrize("ordering", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize("n", [2, 20, 64, 65, 300, 2000])
def test_every_sheet_gets_a_kernel_that_fits(n: int, ordering: str) -> None:
    for real in (np.float32, np.float64):
        one = scene(n, ordering)
        choice = default_choice(one, real, xpbd_parts(one), H200)
        name, why = default_xpbd_kernel(one, real, xpbd_parts(one), H200)
        assert name == choice.name and choice.kernel in ("one-block", "tiled", "graph") and "us" in why
        assert choice.kernel != "one-block" or n <= 64
        tiled = best_tiled(one, real, xpbd_parts(one), H200)
        assert tiled is not None
        assert estimate(one, xpbd_parts(one), choice, H200[0]) <= estimate(one, xpbd_parts(one), tiled, H200[0])


@pytest.fixture
def limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a GPU that is not there."""
    monkeypatch.setattr("softlab.gpu_backend.xpbd.choice.device_limits", lambda: H200)


@pytest.mark.usefixtures("limits")
def test_a_tile_can_be_asked_for() -> None:
    one = scene(40)
    choice = xpbd_kernel(one, np.float32, xpbd_parts(one), "tiled:16x8x250d2")
    assert choice.tile is not None and (choice.tile.rows.owned, choice.tile.columns.owned) == (16, 8)
    assert choice.tile.threads == 256 and choice.depth == 2 and choice.name == "tiled:16x8x256d2"
    assert choice.tile.rows.size == 32 and choice.tile.columns.size == 40


@pytest.mark.parametrize(
    "kernel,what",
    [
        ("tiles", "one of"),
        ("graph:8x8x32d1", "one of"),
        ("one-block:40", "multiple of 32"),
        ("one-block:2048", "multiple of 32"),
        ("tiled:6x8x32d1", "multiples of 4"),
        ("tiled:8x8x2048d1", "threads"),
        ("tiled:8x8x32d0", "iterations"),
        ("tiled:nonsense", "such as"),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("limits")
def test_what_is_no_kernel_is_refused(kernel: str, what: str) -> None:
    one = scene(10)
    with pytest.raises(SceneError, match=what):
        xpbd_kernel(one, np.float32, xpbd_parts(one), kernel)


@pytest.mark.usefixtures("limits")
def test_a_sheet_too_large_for_one_block_is_refused() -> None:
    with pytest.raises(SceneError, match="at most 4096"):
        xpbd_kernel(scene(65), np.float32, xpbd_parts(scene(65)), "one-block")
    assert xpbd_kernel(scene(64), np.float32, xpbd_parts(scene(64)), "one-block") != Choice("one-block")
    jacobi = scene(64, "jacobi")
    with pytest.raises(SceneError, match="shared memory"):  # two copies of 4096 quads of 32 bytes
        xpbd_kernel(jacobi, np.float64, xpbd_parts(jacobi), "one-block")
