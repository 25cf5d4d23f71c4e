"""A cloth's contacts with itself on CUDA, in plain Python: the independent NumPy reference's, and prefix sums as NumPy's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from contact_scenes import crumpled, folded
from numba import cuda

from softlab.app.driver import open_simulation
from softlab.bench.reference.contact import self_contacts as reference
from softlab.gpu_backend.contact.self_contact import Contacts
from softlab.gpu_backend.core.scan import CHUNK, Scan
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.core.build import build
from softlab.model.scene.scene import Scene


@pytest.mark.parametrize("count", [1, CHUNK - 1, CHUNK, 5 * CHUNK + 3])
def test_prefix_sums(count: int) -> None:
    numbers = np.random.default_rng(count).integers(0, 9, count).astype(np.int32)
    counts, starts, cursors = (
        cuda.to_device(numbers),
        cuda.device_array(count, np.int32),
        cuda.device_array(count, np.int32),
    )
    Scan(count, 0).run(counts, starts, cursors)
    expected = np.cumsum(numbers) - numbers
    assert np.array_equal(starts.copy_to_host(), expected) and np.array_equal(cursors.copy_to_host(), expected)


def contacts_of(
    scene: Scene, weights: np.ndarray, before: np.ndarray, predicted: np.ndarray
) -> tuple[Contacts, np.ndarray]:
    """The contacts between two states, and the positions after one sweep."""
    contacts = Contacts(scene, build(scene), np.float64, "exact", weights, 0)
    quads = [cuda.to_device(np.concatenate([a, weights[:, None]], axis=1).reshape(-1)) for a in (before, predicted)]
    contacts.find(*quads)
    contacts.project(*quads)
    return contacts, quads[1].copy_to_host().reshape(-1, 4)


def test_what_is_found_and_projected_is_the_references() -> None:
    scene = folded(self_collision={"thickness": 0.09, "sweeps": 1})
    before, predicted = crumpled(scene)
    weights = np.random.default_rng(2).choice([0.0, 0.5, 1.0], len(before))
    contacts, position = contacts_of(scene, weights, before, predicted)
    part, h = scene.self_collision, scene.method.dt / scene.method.substeps
    grid: Any = scene.grid
    found = reference.find(part, grid.rows, grid.columns, grid.spacing, before, predicted, h)
    # a cell's box holds its corners wherever they move, seen from the sheet's middle
    motion = np.linalg.norm(
        predicted - before - (predicted - before)[grid.rows // 2 * grid.columns + grid.columns // 2], axis=1
    )
    corner = np.arange(grid.rows * grid.columns).reshape(grid.rows, grid.columns)
    four = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]]).reshape(4, -1)
    moved, boxes = motion[four].max(axis=0)[:, None], contacts._boxes.copy_to_host().reshape(-1, 2, 4)[:, :, :3]
    np.testing.assert_allclose(boxes[:, 0], before[four].min(axis=0) - moved, atol=1e-14)
    np.testing.assert_allclose(boxes[:, 1], before[four].max(axis=0) + moved, atol=1e-14)
    counts = np.bincount(found.mass, minlength=len(before))
    assert np.array_equal(contacts.contact_counts.copy_to_host(), counts)
    assert contacts.lost == np.maximum(counts - MAX_CONTACTS, 0).sum() > 0
    expected = reference.project(part, found.nearest(MAX_CONTACTS), before, predicted, weights)
    assert np.abs(position[:, :3] - expected).max() < 1e-13  # some tens of roundings of lengths under 1 m
    assert np.array_equal(position[:, 3], weights)


@pytest.mark.parametrize("rows,columns", [(1, 1), (1, 5), (5, 1), (2, 2)])
def test_sheets_too_small_to_fold(rows: int, columns: int) -> None:
    """Of those without a triangle nothing is found, and nothing fails."""
    scene = folded(rows, columns, layer=2, self_collision={"thickness": 0.02})
    with open_simulation(scene, "gpu", math="exact", kernel="launch") as simulation:
        simulation.advance(1)
        assert np.isfinite(simulation.state().position).all()
