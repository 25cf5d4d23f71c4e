"""The finding about diagonals: its closed form, its mirror, and that it sees what it is for."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.bench.experiments.discretisation import (
    BIAS,
    DIAGONALS,
    bias,
    exact_ratio,
    experiments,
    mirrored,
    sheet,
    stretch_ratio,
)
from softlab.model.core.build import rest_positions


@pytest.mark.parametrize("side", [5, 6, 25])
@pytest.mark.parametrize("diagonals", DIAGONALS)
def test_the_stretch_ratio_is_that_of_its_edges(diagonals: str, side: int) -> None:
    """To the first order in the strain of 1e-4, which a ratio of 5 carries: 1e-3."""
    np.testing.assert_allclose(stretch_ratio(sheet(diagonals, side)), exact_ratio(diagonals, side), rtol=1e-3)


def test_alternating_diagonals_are_alike_and_one_is_not() -> None:
    assert exact_ratio("alternating") == 1.0
    assert 4.5 < exact_ratio("one") < exact_ratio("one", 1001) < 5.0  # 5 without rims: (1/2 + 2) / (1/2)


def test_the_mirror_image_of_the_mirror_image_is_the_sheet() -> None:
    rest = rest_positions(sheet("one", 5).grid)
    np.testing.assert_allclose(mirrored(rest, 5), rest, atol=1e-15)
    moved = rest + np.random.default_rng(2).normal(size=rest.shape)
    np.testing.assert_allclose(mirrored(mirrored(moved, 5), 5), moved)
    assert bias(rest, 5) < 1e-12 < bias(moved, 5)


def test_one_diagonal_is_further_from_its_mirror_image() -> None:
    """A sheet of 7 x 7 for a quarter of a second: what is left of the alternating one's is the order of its colours."""
    found = {}
    for diagonals in DIAGONALS:
        with open_simulation(sheet(diagonals, 7), "cpu", precision="float64", math="exact", threads=1) as simulation:
            simulation.advance(15)
            found[diagonals] = bias(simulation.state().position, 7)
    assert found["one"] > 5 * found["alternating"]


def test_experiments_are_one_for_each_way() -> None:
    made = experiments("cpu")
    assert [experiment.description["diagonals"] for experiment in made] == list(DIAGONALS)
    assert {experiment.name for experiment in made} == {BIAS}
    assert len({experiment.description["scene"]["mesh"]["diagonals"] for experiment in made}) == 2
