"""The coarse level of Newton's method on tetrahedra: groups, the coarse matrix, its factor, and what it does to a solve."""

from __future__ import annotations

import numpy as np
import pytest
from test_newton import STILL, bar, opened, start

from softlab.cpu_backend.tetrahedra.newton_arrays import Coarse
from softlab.cpu_backend.tetrahedra.newton_coarse import centre, corrected, factor, gather, restrict, solve
from softlab.model.tetrahedra.aggregates import MOST, aggregates
from softlab.model.tetrahedra.block_rows import block_rows


def test_groups_hold_each_free_particle_once_and_reach_as_far_as_the_matrix() -> None:
    found = bar((1.0, 0.2, 0.1), edge=0.05).tetrahedra_set
    free = np.ones(found.particle_count, bool)
    free[found.pinned_vertices] = False
    rows = block_rows(found.tetrahedra, found.particle_count)
    groups = aggregates(found, rows, free)
    assert np.array_equal(np.sort(groups.members), np.flatnonzero(free)) and 1 < groups.number <= MOST
    assert (groups.group[~free] == -1).all()
    for number in range(groups.number):
        assert (groups.group[groups.members[groups.starts[number] : groups.starts[number + 1]]] == number).all()
    for k in np.flatnonzero(free):
        met = groups.group[rows.columns[rows.starts[k] : rows.starts[k + 1]]]
        assert 6 * met.max() + 5 <= groups.last_column[6 * groups.group[k]]
    assert groups.width < 6 * groups.number / 2  # a slender body has a band


def test_the_coarse_level_is_the_matrix_seen_by_rigid_motions() -> None:
    """P (P'AP)^-1 P' r by dense matrices, and a group that has fallen into a point, where three motions are none."""
    found = bar((0.4, 0.1, 0.1), beam__pinned=[]).tetrahedra_set
    count, random = found.particle_count, np.random.default_rng(0)
    rows = block_rows(found.tetrahedra, count)
    groups = aggregates(found, rows, np.ones(count, bool))
    assert groups.number == 2
    position = found.position + 0.01 * random.normal(size=found.position.shape)
    position[groups.group == 1] = position[groups.group == 1][0]
    full = np.zeros((3 * count, 3 * count))
    for k in range(count):
        for n in range(rows.starts[k], rows.starts[k + 1]):
            full[3 * k : 3 * k + 3, 3 * rows.columns[n] : 3 * rows.columns[n] + 3] = random.normal(size=(3, 3))
    full = full @ full.T * (full != 0) + 200 * np.eye(3 * count)
    full = (full + full.T) / 2
    blocks = np.zeros((len(rows.columns), 9))
    for k in range(count):
        for n in range(rows.starts[k], rows.starts[k + 1]):
            c = rows.columns[n]
            blocks[n] = full[3 * k : 3 * k + 3, 3 * c : 3 * c + 3].ravel()
    size = 6 * groups.number
    shapes = (groups.number, 4), (size, groups.width), (1, size), (1, size)
    coarse = Coarse(*(np.zeros(shape) for shape in shapes))
    residual = random.normal(size=(count, 3))
    centre(0, groups.number, position, groups, coarse)
    gather(0, groups.number, position, rows, blocks, groups, coarse)
    assert not factor(coarse, groups)
    restrict(0, groups.number, position, residual, groups, coarse)
    solve(coarse, groups)
    got = np.array([corrected(k, position, groups, coarse) for k in range(count)])
    rigid = np.zeros((3 * count, size))
    for k in range(count):
        a = groups.group[k]
        arm = position[k] - position[groups.group == a].mean(axis=0)
        rigid[3 * k : 3 * k + 3, 6 * a : 6 * a + 3] = np.eye(3)
        rigid[3 * k : 3 * k + 3, 6 * a + 3 : 6 * a + 6] = np.cross(np.eye(3), arm).T
    rigid = rigid[:, np.abs(rigid).max(axis=0) > 1e-9]
    want = rigid @ np.linalg.solve(rigid.T @ full @ rigid, rigid.T @ residual.ravel())
    np.testing.assert_allclose(got.ravel(), want, atol=1e-9)


@pytest.mark.parametrize("young", [1e5, 1e7])
def test_a_step_needs_few_products_whatever_the_stiffness(young: float) -> None:
    """Without the coarse level 30 and 105, with it 9 and 16."""
    scene = bar((1.0, 0.1, 0.1), edge=0.05, beam__young_modulus=young, method__iterations=1, **STILL)
    with opened(scene) as simulation:
        position = simulation.state().position
        start(simulation, position, 0.1 * position[:, :1] * [0.0, -1.0, 0.0])
        simulation.advance(10)
        products = simulation.done[3]  # type: ignore[attr-defined]
    assert products <= 250
