"""The tiling of the GPU's kernels, emulated in NumPy: tiles advanced by themselves, then put together, are the grid.

What a tile computes is computed here by the same few lines for a whole grid and for a tile cut out of it, so that any
difference is a fault of the cutting: of starts, halos, owned ranges. Then a grid of any shape must come out bit for bit.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab.gpu_backend.core.tiling import Tile, owned, tile_count, whole_strips

DT, STIFFNESS = 0.01, 1000.0


def step(position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One semi-implicit Euler step of unit springs between the four neighbours; (rows, columns, 2) each."""
    acceleration = np.zeros_like(position)
    for axis in (0, 1):
        difference = np.diff(position, axis=axis)
        length = np.sqrt((difference**2).sum(axis=-1, keepdims=True))
        pull = STIFFNESS * (1 - 1 / np.where(length > 0, length, 1)) * difference
        before = [(0, 0)] * 3
        before[axis] = (0, 1)
        after = [(0, 0)] * 3
        after[axis] = (1, 0)
        acceleration = acceleration + (np.pad(pull, before) - np.pad(pull, after))
    velocity = velocity + DT * acceleration
    return position + DT * velocity, velocity


def tiled(position: np.ndarray, velocity: np.ndarray, tile: Tile, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """`steps` steps of the grid, tile by tile as the kernels cut it."""
    rows, columns = position.shape[:2]
    down, across = tile_count(rows, tile.rows, tile.halo), tile_count(columns, tile.columns, tile.halo)
    new_position, new_velocity = np.full_like(position, np.nan), np.full_like(velocity, np.nan)
    for block_row in range(down):
        row_start, row_first, row_end = owned(block_row, down, rows, tile.rows, tile.halo)
        for block_column in range(across):
            start, first, end = owned(block_column, across, columns, tile.columns, tile.halo)
            cut = (slice(row_start, row_start + tile.rows), slice(start, start + tile.columns))
            p, v = position[cut], velocity[cut]
            for _ in range(steps):
                p, v = step(p, v)
            inside = (slice(row_first, row_end), slice(first, end))
            assert np.isnan(new_position[inside]).all(), "two tiles own a mass"
            own = (slice(row_first - row_start, row_end - row_start), slice(first - start, end - start))
            new_position[inside], new_velocity[inside] = p[own], v[own]
    return new_position, new_velocity


def random_state(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(rows * 1000 + columns)
    rest = np.stack(np.meshgrid(np.arange(columns), -np.arange(rows)), axis=-1).astype(float)
    return rest + generator.normal(0, 0.1, rest.shape), generator.normal(0, 1, rest.shape)


@st.composite
def tiles(draw: st.DrawFn) -> Tile:
    halo = draw(st.integers(1, 4))
    strip = draw(st.integers(1, 5))
    strips = draw(st.integers(-(-3 * halo // strip), 12))
    return Tile(draw(st.integers(3 * halo, 20)), max(strips, -(-3 * halo // strip)), strip, halo)


@settings(deadline=None, max_examples=60)
@given(tiles(), st.integers(1, 70), st.integers(1, 70))
def test_tiles_put_together_are_the_grid(tile: Tile, rows: int, columns: int) -> None:
    state = random_state(rows, columns)
    expected = state
    for _ in range(tile.halo):
        expected = step(*expected)
    found = tiled(*state, tile, tile.halo)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_one_step_more_than_the_halo_is_wrong() -> None:
    """The test above can fail: a halo of 2 carries two steps and no third."""
    state = random_state(40, 40)
    expected = state
    for _ in range(3):
        expected = step(*expected)
    assert not np.array_equal(tiled(*state, Tile(12, 3, 4, 2), 3)[0], expected[0])


@settings(deadline=None)
@given(tiles(), st.integers(1, 500))
def test_every_mass_has_one_owner_and_every_halo_one_neighbour(tile: Tile, masses: int) -> None:
    """What `resident` relies on: a halo lies in what the next tile owns, and not in two of them."""
    size, halo = tile.columns, tile.halo
    count = tile_count(masses, size, halo)
    ranges = [owned(index, count, masses, size, halo) for index in range(count)]
    assert ranges[0][1] == 0 and ranges[-1][2] == masses
    for (_, _, end), (_, first, _) in pairwise(ranges):
        assert end == first
    for index, (start, first, end) in enumerate(ranges):
        assert 0 <= start <= first < end <= min(start + size, masses)
        if index > 0:
            assert first - start == halo and ranges[index - 1][1] <= start
        if index < count - 1:
            assert min(end + halo, masses) <= ranges[index + 1][2] and end + halo <= start + size


@pytest.mark.parametrize(
    ("rows", "tile", "whole"),
    [
        (64, Tile(8, 4, 4, 2), True),
        (64, Tile(8, 4, 3, 2), False),
        (62, Tile(8, 4, 4, 2), False),
        (64, Tile(8, 2, 8, 2), False),
    ],
)
def test_strips_are_whole_where_starts_and_edge_fall_between_them(rows: int, tile: Tile, whole: bool) -> None:
    assert whole_strips(rows, tile) is whole
    count = tile_count(rows, tile.rows, tile.halo)
    cuts = {(rows - owned(index, count, rows, tile.rows, tile.halo)[0]) % tile.strip for index in range(count)}
    assert (cuts == {0}) is whole
