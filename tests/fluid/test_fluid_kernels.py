"""Kernels of fluids and what they are scaled by: integrals, lattices, walls. NUMERICS A12 and F3."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from fluid_scenes import D, column_scene

from softlab.bench.reference.fluid import run
from softlab.model.base.variant import plain_formulas
from softlab.model.fluid.parameters import fluid_record
from softlab.model.formulas.fluid import density
from softlab.model.particles.fluid_lattice import lattice_of, poly6, spiky_slope

SHELL = {2: lambda r: 2 * pi * r, 3: lambda r: 4 * pi * r * r}  # of all points r away


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize(("real", "least"), [(np.float64, 1e-5), (np.float32, 1e-4)])
def test_kernels_integrate_to_one(axes: int, real: type, least: float) -> None:
    """W itself, and the spiky kernel, whose slope by parts makes -integral of dW/dr r / axes."""
    h = 0.7
    r = (np.arange(20_000) + 0.5) / 20_000 * h
    weight = SHELL[axes](r) * h / 20_000
    assert np.sum(poly6(r.astype(real), h, axes) * weight) == pytest.approx(1, abs=least)
    assert np.sum(spiky_slope(r.astype(real), h, axes) * r / axes * weight) == pytest.approx(1, abs=least)


@pytest.mark.parametrize(
    ("across", "told", "neighbours"),
    [
        (1.5, 0.949417, 19), (1.8, 0.982843, 27), (2.0, 1.009775, 27), (2.5, 0.995431, 81), (3.0, 1.002189, 93),
        (4.0, 0.999998, 251),
    ],
)  # fmt: skip
def test_lattice_sums_are_those_of_a12(across: float, told: float, neighbours: int) -> None:
    """A mass of rho0 d^3 would make that much of the density; the calibrated one makes all of it."""
    lattice = lattice_of(1.0, across, 3)
    assert 1 / lattice.volume == pytest.approx(told, abs=5e-7)
    places = np.stack(np.meshgrid(*[np.arange(-5, 6)] * 3), axis=-1).reshape(-1, 3)
    assert (np.linalg.norm(places, axis=1) < across).sum() == neighbours


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("across", [1.5, 1 / 0.55, 2.4])
def test_the_formulas_are_the_kernels(axes: int, across: float) -> None:
    lattice, f = lattice_of(D, across * D, axes), plain_formulas(density, float)
    h, r = across * D, np.linspace(0.05, 1.2, 40) * across * D
    weights = [lattice.smoothing_scale * f.near(x * x, 1 / h) ** 3 for x in r]
    assert weights == pytest.approx(lattice.volume * poly6(r, h, axes), abs=1e-12)
    slopes = np.array([f.slope(x * x, 1 / h, lattice.gradient_scale) * x for x in r])
    wanted = spiky_slope(r, h, axes)
    assert slopes / slopes[0] == pytest.approx(wanted / wanted[0], abs=1e-12)


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("across", [1.2, 1.5, 1 / 0.55, 2.4, 4.0])
def test_a_correction_follows_the_gradient_of_its_constraint(axes: int, across: float) -> None:
    """The slopes of neighbours and walls are derivatives of what they add to C, or the force would do work along motions that
    keep C; the lattice has C = 0, and a dilatation e changes it by -axes e."""
    lattice, f, h, step = lattice_of(D, across * D, axes), plain_formulas(density, float), across * D, 1e-6 * D

    def added(x: float) -> float:
        return float(lattice.density_scale * f.density_added(0.0, f.closeness(x * x, 1 / h)))

    def wall(x: float) -> float:
        return float(f.wall_density(f.wall_near(x, 1 / lattice.wall_range), lattice.wall_scale))

    for x in np.linspace(0.05, 1.1, 30) * h:
        slope = f.slope(x * x, 1 / h, lattice.gradient_scale) * x
        assert (added(x - step) - added(x + step)) / (2 * step) == pytest.approx(slope, rel=1e-6, abs=1e-6 / D)
        steepness = f.wall_slope(f.wall_near(x, 1 / lattice.wall_range), lattice.wall_gradient)
        assert (wall(x + step) - wall(x - step)) / (2 * step) == pytest.approx(steepness, rel=1e-6, abs=1e-6 / D)
    places = np.stack(np.meshgrid(*[np.arange(-5, 6)] * axes), axis=-1).reshape(-1, axes) * D
    r = np.linalg.norm(places, axis=1)
    r, behind = r[r > 0], places[r > 0, 1] < 0
    total = sum(f.density_added(0.0, f.closeness(x * x, 1 / h)) for x in r)
    assert f.constraint(total, lattice.kernel_sum, lattice.density_scale, 0.0) == pytest.approx(0, abs=1e-12)
    wider = sum(added(x * 1.000001) - added(x) for x in r)
    assert wider / 1e-6 == pytest.approx(-axes, rel=1e-4)
    assert wall(D / 2) == pytest.approx(sum(added(x) for x in r[behind]))


def test_a_lattice_beside_a_wall_lacks_nothing_and_is_not_moved() -> None:
    """No jump at the start: C = 0 inside and in the layer at the floor, but for the 1e-4 that the wall adds to the next one;
    without gravity nothing moves by more than a thousandth of the rest distance."""
    scene = column_scene(**{"gravity.enabled": False})
    start = scene.fluid_set
    position, _, c, _ = run(scene, 1, start.position, start.velocity)
    below = start.position[:, 1] < start.position[:, 1].max() - D
    assert np.abs(c[below]).max() < 1e-4 and c.max() < 1e-4
    assert np.abs(position - start.position).max() < 1e-3 * D


def test_the_pressure_of_walls_is_mirrored() -> None:
    """Under one pressure the layer at a wall is pushed by neighbours as much as by the wall, the other way."""
    scene = column_scene()
    record, f = fluid_record(scene, np.float64)[0], plain_formulas(density, float)
    places = np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3), axis=-1).reshape(-1, 3) * D
    above = places[(places[:, 1] >= 0) & (places != 0).any(axis=1)]
    pushed = sum(
        f.gradient_added(0.0, f.slope(f.squared(*-d), record.inverse_support, record.gradient_scale), -d[1])
        for d in above
    )
    wall = f.wall_slope(f.wall_near(D / 2, record.inverse_wall), record.wall_gradient)
    assert wall == pytest.approx(-2 * pushed, rel=1e-12) and wall < 0


def test_walls_in_a_corner_are_not_counted_twice() -> None:
    f = plain_formulas(density, float)
    once = f.joined_density(0.0, 0.3)
    assert once == 0.3 and f.joined_density(once, 0.3) == pytest.approx(1 - 0.7**2)
    assert f.joined_density(1.3, 0.3) == f.joined_density(0.3, 1.3) == 1.3
    assert f.joined_gradient(-2.0, 1.3, -5.0, 0.3, 1.0) == -2.0 and f.joined_gradient(-2.0, 0.3, -5.0, 1.3, 1.0) == -5.0
    step, t = 1e-6, 0.4

    def both(x: float) -> float:
        return f.joined_density(f.joined_density(0.0, f.wall_density(f.wall_near(x, 1.0), 0.9)), 0.2)

    slope = f.joined_gradient(0.0, 0.0, -0.9 * 3 * (1 - t) ** 2, f.wall_density(f.wall_near(t, 1.0), 0.9), 1.0)
    total = f.joined_density(0.0, f.wall_density(f.wall_near(t, 1.0), 0.9))
    found = f.joined_gradient(slope, total, 0.0, 0.2, 1.0)
    assert found == pytest.approx((both(t + step) - both(t - step)) / (2 * step), rel=1e-6)
