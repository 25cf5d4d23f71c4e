"""The largest frequency of a net against the closed forms of docs/method/cases.md A1 and against dense matrices."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab.model.core.build import pinned_indices
from softlab.model.core.integrators import frequency_bound
from softlab.model.core.stability.limit import (
    MAX_MASSES,
    Net,
    frequency_lines,
    grid_eigenvalue,
    largest_frequency,
    scene_frequency,
    scene_net,
)
from softlab.model.scene.scene import Scene, load_scene


def grid(rows: int, columns: int, pinned: object = "none", **springs: float) -> Scene:
    return Scene({"grid": {"rows": rows, "columns": columns, "pinned": pinned}, "springs": springs})


def dense(net: Net) -> np.ndarray:
    """A as a matrix, row by row."""
    return np.stack([net.apply(row) for row in np.eye(len(net.inverse_mass))])


@pytest.mark.parametrize(
    ("size", "pinned", "printed"),
    [
        (10, "none", 7.804226), (10, "top", 7.793748), (10, "edges", 7.758770),
        (30, "none", 7.978088), (30, "top", 7.977713), (30, "edges", 7.976552), (1024, "none", 7.999981),
    ],
)  # fmt: skip
def test_closed_forms_are_the_printed_ones(size, pinned, printed):
    """A1's table of the grid's Laplacian, to its printed digits."""
    assert grid_eigenvalue(grid(size, size, pinned).grid)[0] == pytest.approx(printed, abs=6e-7)


@pytest.mark.parametrize("pinned", ["none", "top", "edges"])
@pytest.mark.parametrize("shape", [(10, 10), (30, 30), (7, 12), (3, 40), (2, 5), (9, 3)])
def test_iteration_equals_the_closed_form(shape, pinned):
    """To 1e-6, from below; the rigorous bound lies above; the closed form's shape is the vibration's."""
    scene = grid(*shape, pinned, stiffness=10.0)
    value, mode = grid_eigenvalue(scene.grid)
    net = scene_net(scene)
    found = largest_frequency(net)
    exact = sqrt(value * 10 / 0.01)
    assert found.converged and found.iterations < 1000
    assert found.estimate == pytest.approx(exact, rel=1e-6)
    assert found.estimate <= exact * (1 + 1e-12) <= found.upper * (1 + 1e-9)
    assert found.upper <= frequency_bound(scene) * (1 + 1e-9)
    assert np.abs(net.apply(mode) - 1000 * value * mode).max() <= 1e-9 * 1000 * value
    assert not mode[pinned_indices(scene.grid)].any()


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (6, 1), (2, 2)])
@pytest.mark.parametrize("pinned", ["none", "top", "edges", "top-corners", "left"])
def test_thin_grids(shape, pinned):
    """Chains, one mass, and grids all of whose masses are held (which do not vibrate)."""
    scene = grid(*shape, pinned)
    largest = np.linalg.eigvalsh(dense(scene_net(scene)))[-1]
    assert scene_frequency(scene).estimate == pytest.approx(sqrt(max(0.0, largest)), rel=1e-6, abs=1e-6)


@settings(deadline=None, max_examples=60)
@given(st.integers(2, 14), st.integers(0, 10**6))
def test_any_net_against_its_matrix(count, seed):
    """Random graphs with odd cycles, stiffnesses over six decades, masses over three, some pinned: the estimate from
    below, within what its residual promises; the bound from above."""
    random = np.random.default_rng(seed)
    pairs = np.stack(np.triu_indices(count, 1), axis=1)
    ends = pairs[random.random(len(pairs)) < 0.6]
    inverse_mass = 10 ** random.uniform(-1, 2, count) * (random.random(count) < 0.8)
    net = Net(ends, 10 ** random.uniform(-2, 4, len(ends)), inverse_mass)
    found = largest_frequency(net)
    matrix = dense(net)
    assert np.allclose(matrix, matrix.T, rtol=1e-12, atol=1e-9 * np.abs(matrix).max())
    exact = sqrt(max(0.0, np.linalg.eigvalsh(matrix)[-1]))
    assert found.converged
    assert found.estimate == pytest.approx(exact, rel=1e-6, abs=1e-9)
    assert found.upper >= exact * (1 - 1e-9)


def test_pins_anywhere_lie_between_and_the_same_every_time():
    """Two pinned corners: under the free grid's; equal to the dense matrix; nothing random in it."""
    scene = load_scene("lab-grid").replace({"grid.rows": 12, "grid.columns": 9})
    found, again = scene_frequency(scene), scene_frequency(scene)
    assert (found.how, found.estimate, found.upper) == ("iterated", again.estimate, again.upper)
    assert found.estimate == pytest.approx(sqrt(np.linalg.eigvalsh(dense(scene_net(scene)))[-1]), rel=1e-6)
    assert found.estimate <= found.upper <= sqrt(1000 * grid_eigenvalue(grid(12, 9).grid)[0]) * (1 + 1e-12)


def test_large_grids_are_bounded_not_iterated():
    scene = load_scene("lab-grid").replace({"grid.rows": 512, "grid.columns": 512})
    assert scene.grid.particle_count > MAX_MASSES
    found = scene_frequency(scene)
    assert found.how == "bounded" and 89.44 < found.upper < frequency_bound(scene)
    assert "bound" in frequency_lines(scene)[0]


def test_an_end_without_convergence_is_said():
    found = largest_frequency(scene_net(grid(20, 20)), most=3)
    assert (found.converged, found.iterations) == (False, 3)
    assert found.estimate < found.upper


def test_what_the_plan_says():
    """The step size that follows, of this net; nothing where there are no springs; euler without a damper."""
    (line,) = frequency_lines(grid(10, 10, "top"))
    assert "88.2822 1/s of this net (closed form), 89.4427 1/s of any grid" in line
    assert "velocity-verlet holds to dt 0.0226546 s" in line
    assert frequency_lines(Scene({"grid": {"rows": 3, "columns": 3}})) == []
    assert frequency_lines(load_scene("hard/b2")) == []  # whose links do not give
    euler = grid(10, 10).replace({"method.integrator": "explicit-euler"})
    assert "explicit-euler holds at no dt" in frequency_lines(euler)[0]
