"""The measure of how a cloth keeps out of itself: closed forms, and every pair."""

from __future__ import annotations

import numpy as np
import pytest
from contact_scenes import SPACING, crumpled, folded

from softlab.bench.reference.contact.self_contacts import nearest_weights, triangles
from softlab.model.contact.penetration import measure

ROWS, COLUMNS = 4, 4
FLAT = np.array([(j * SPACING, 0.0, i * SPACING) for i in range(ROWS) for j in range(COLUMNS)])


def test_a_flat_sheet_has_no_pair_within_the_thickness() -> None:
    found = measure(ROWS, COLUMNS, SPACING, FLAT, 0.02)
    assert (found.min_gap, found.min_edge_gap, found.edge_misses, found.crossings) == (np.inf, np.inf, 0, 0)


def test_a_mass_over_a_triangle_is_as_near_as_it_was_laid() -> None:
    """The last mass over the first cell, at a height; its neighbours 1 m above, so that its own triangles rise steeply."""
    position = FLAT.copy()
    position[[10, 11, 14], 1] = 1.0
    position[15] = (0.04, 0.013, 0.06)
    found = measure(ROWS, COLUMNS, SPACING, position, 0.02)
    assert found.min_gap == pytest.approx(0.013, abs=1e-15)
    assert found.crossings == 0


def test_an_edge_through_the_sheet_is_a_crossing_and_a_missed_edge() -> None:
    """The last row's last edge stands across the sheet, 7.07 mm from the diagonal of the cell that it goes through, its ends
    5 cm off: no mass is within the thickness of a triangle, so a contact of masses alone sees nothing."""
    position = FLAT.copy()
    position[15], position[14] = (0.13, -0.05, 0.12), (0.13, 0.05, 0.12)
    found = measure(ROWS, COLUMNS, SPACING, position, 0.02)
    assert found.min_gap == np.inf
    assert found.min_edge_gap == pytest.approx(0.01 / np.sqrt(2), rel=1e-12)
    assert (found.edge_misses, found.crossings) == (1, 1)


def test_the_smallest_gap_is_that_of_all_pairs() -> None:
    scene = folded(12, 7, layer=4)
    position, _ = crumpled(scene)
    every, thickness, best = triangles(12, 7), 0.05, np.inf
    flat = np.stack(np.divmod(np.arange(84), 7), axis=1) * SPACING
    for mass in range(84):
        own = every[(every != mass).all(axis=1)]
        weights = nearest_weights(np.repeat(position[mass][None], len(own), axis=0), position[own])
        now, rest = (p[mass] - np.einsum("nk,nkd->nd", weights, p[own]) for p in (position, flat))
        far = np.linalg.norm(rest, axis=1) >= thickness
        best = min(best, float(np.linalg.norm(now, axis=1)[far].min()))
    assert measure(12, 7, SPACING, position, thickness).min_gap == pytest.approx(best, abs=1e-14)


@pytest.mark.parametrize("rows,columns", [(1, 1), (1, 9), (9, 1)])
def test_sheets_without_triangles(rows: int, columns: int) -> None:
    assert measure(rows, columns, SPACING, np.zeros((rows * columns, 3)), 0.02).min_gap == np.inf
