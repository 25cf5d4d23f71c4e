"""The tiling of the cloth's kernels: every mass has one owner, and what a block does by itself lies on its tile."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab.gpu_backend.core.tiling import Tile, parsed_tile, tile_count
from softlab.gpu_backend.mass_spring.cloth.tiling import (
    fields,
    most_to_fetch,
    overlap_of,
    plane_shape,
    span,
    stencil_rows,
    tile_bytes,
)

SPRINGS = frozenset({"structural", "shear", "bending"})
FEW = frozenset({"structural", "shear"})


@st.composite
def axes(draw: st.DrawFn) -> tuple[int, int, int, int]:
    """(masses, size of a tile, reach, halo) of an axis that a tile fits."""
    reach, halo = draw(st.integers(1, 2)), draw(st.integers(1, 4))
    size = draw(st.integers(2 * reach * (halo - 1) + 1, 40))
    return draw(st.integers(size, 300)), size, reach, halo


@settings(deadline=None, max_examples=300)
@given(axes())
def test_what_blocks_own_and_need(axis: tuple[int, int, int, int]) -> None:
    """Along an axis: what is owned adds up to the sheet; of what is owned each of a round's steps asks for `reach` rings
    more, and those of the first step are read, so all but `reach` rings must be computed: they lie on the tile."""
    masses, size, reach, halo = axis
    overlap, rings = reach * (halo - 1), reach * halo
    count = tile_count(masses, size, overlap)
    spans = [span(index, count, masses, size, overlap) for index in range(count)]
    assert spans[0][1] == 0 and spans[-1][2] == masses
    for (_, _, end), (_, first, _) in pairwise(spans):
        assert end == first
    for start, first, end in spans:
        assert first < end and start >= 0 and start + size <= masses
        assert start <= max(first - overlap, 0) and min(end + overlap, masses) <= start + size
        assert start - reach <= max(first - rings, 0) and min(end + rings, masses) <= start + size + reach
        if first > 0 and end < masses:
            assert end - first <= size - 2 * overlap


@settings(deadline=None, max_examples=100)
@given(
    st.integers(1, 3), st.integers(1, 12), st.integers(1, 12), st.integers(1, 4), st.integers(0, 60), st.integers(0, 60)
)
def test_no_block_fetches_more_than_it_has_room_for(
    halo: int, columns: int, strips: int, strip: int, more_rows: int, more_columns: int
) -> None:
    for parts in (SPRINGS, FEW):
        overlap, rings = stencil_rows(parts) * (halo - 1), stencil_rows(parts) * halo
        tile = Tile(columns + 2 * overlap, strips + 2 * overlap, strip, halo)
        sheet = tile.rows + more_rows, tile.columns + more_columns
        needs = []
        for masses, size in zip(sheet, (tile.rows, tile.columns), strict=True):
            count = tile_count(masses, size, overlap)
            spans = [span(index, count, masses, size, overlap) for index in range(count)]
            needs.append({(end - first, min(end + rings, masses) - max(first - rings, 0)) for _, first, end in spans})
        most = max(
            wide_rows * wide_columns - rows * columns
            for rows, wide_rows in needs[0]
            for columns, wide_columns in needs[1]
        )
        assert most <= most_to_fetch(tile, parts)


def test_shared_memory_holds_two_copies_and_the_air() -> None:
    tile = Tile(32, 8, 2, 1)
    assert plane_shape(tile, SPRINGS) == (20, 36) and plane_shape(tile, FEW) == (18, 34)
    assert tile_bytes("float32", tile, SPRINGS) == (2 * 3 * 20 * 36 + 8) * 4
    for parts in (SPRINGS | {"wind"}, SPRINGS | {"shear-damping"}):
        assert fields(tile, parts) == 6
    assert fields(Tile(32, 8, 2, 2), SPRINGS) == 6  # overlaps are renewed with their velocities
    assert overlap_of(Tile(32, 8, 2, 3), SPRINGS) == 4 and overlap_of(Tile(32, 8, 2, 3), FEW) == 2


def test_tables_of_tiles_can_be_launched() -> None:
    """Every tile of the tables, on the GPU that they were measured on; and which sheets the larger ones fit."""
    from softlab.gpu_backend.mass_spring.cloth.choice import RESIDENT, cloth_tiles_of
    from softlab.gpu_backend.mass_spring.cloth.launch import why_no_cloth_tile
    from softlab.gpu_backend.mass_spring.grid.choice import MEASURED_LIMITS

    for real in (np.float32, np.float64):
        for name in RESIDENT[real]:
            tile = parsed_tile(name)
            assert not why_no_cloth_tile(tile.rows, tile.columns, real, tile, SPRINGS, MEASURED_LIMITS), name
        assert cloth_tiles_of(512, 512, real, SPRINGS, MEASURED_LIMITS)
    assert cloth_tiles_of(1024, 1024, np.float32, SPRINGS, MEASURED_LIMITS)
    assert not cloth_tiles_of(2048, 2048, np.float32, SPRINGS, MEASURED_LIMITS)
    assert not cloth_tiles_of(7, 7, np.float32, SPRINGS, MEASURED_LIMITS)


@pytest.mark.parametrize(
    "tile,sheet,word",
    [
        (Tile(64, 32, 1, 1), (64, 64), "2048 threads"),
        (Tile(128, 8, 16, 1), (128, 128), "bytes of shared memory"),
        (Tile(8, 8, 1, 0), (64, 64), "at least one step"),
        (Tile(8, 8, 1, 1), (64, 4), "larger than the sheet"),
        (Tile(8, 8, 1, 3), (64, 64), "too small for 3 steps"),
        (Tile(8, 8, 1, 1), (512, 512), "runs 1056 at once"),
        (Tile(1, 1, 16, 1), (64, 64), "too few threads"),
    ],
)
def test_tiles_that_cannot_be_say_why(tile: Tile, sheet: tuple[int, int], word: str) -> None:
    from softlab.gpu_backend.mass_spring.cloth.launch import why_no_cloth_tile
    from softlab.gpu_backend.mass_spring.grid.choice import MEASURED_LIMITS

    assert word in why_no_cloth_tile(*sheet, np.float32, tile, SPRINGS, MEASURED_LIMITS)


def test_the_fastest_by_the_tables_is_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Invented times: a small tile that slows down where blocks share a multiprocessor, and a larger one."""
    from softlab.gpu_backend.mass_spring.cloth import choice as cloth_choice
    from softlab.gpu_backend.mass_spring.grid.choice import MEASURED_LIMITS
    from softlab.model.contact.sheet_plan import cloth_parts
    from softlab.model.scene.scene import load_scene

    tables = {"8x8x1h1": {1: 0.8, 8: 2.0}, "64x8x4h1": {1: 1.9}, "16x16x1h1": {}}
    monkeypatch.setitem(cloth_choice.RESIDENT, np.float32, tables)
    for name, side, kernel, tile in (
        ("cloth-hanging", 16, "one-block", None),
        ("cloth-hanging", 32, "resident", "8x8x1h1"),
        ("cloth-hanging", 88, "resident", "8x8x1h1"),  # 121 blocks on 132 multiprocessors
        ("cloth-hanging", 128, "resident", "64x8x4h1"),  # 256
        ("cloth-hanging", 2048, "graph", None),
        ("cloth-wind", 128, "graph", None),  # velocity Verlet, two passes a step
    ):
        scene = load_scene(name).replace({"cloth.rows": side, "cloth.columns": side})
        found, chosen, why = cloth_choice.choose_cloth(scene, np.float32, cloth_parts(scene), MEASURED_LIMITS)
        assert (found, chosen.name if chosen else None) == (kernel, tile), (name, side)
        assert "us per step by the table" in why
    scene = load_scene("cloth-hanging").replace({"method.integrator": "rk4"})
    assert cloth_choice.choose_cloth(scene, np.float32, cloth_parts(scene), MEASURED_LIMITS)[0] == "graph"
