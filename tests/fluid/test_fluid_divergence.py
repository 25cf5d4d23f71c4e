"""The scheme `divergence-free`: what its solves do, by the judge; laws of its numbers, and how fast iterations converge."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fluid_scenes import D, column_scene, ends, free, shaken

from softlab.bench.reference.fluid import _Pairs, _places, _World
from softlab.bench.reference.fluid_divergence import DivergenceFree
from softlab.model.base.errors import SceneError
from softlab.model.base.variant import plain_formulas
from softlab.model.core.families import family_of
from softlab.model.formulas.fluid import divergence
from softlab.model.scene.scene import Scene

METHOD = {"solver": "pbf", "scheme": "divergence-free", "dt": 1 / 60, "substeps": 4, "iterations": 5}


def drop(size: float = 6 * D, **method: Any) -> Scene:
    """A cube of particles without walls or weight."""
    return Scene({"water": {"kind": "fluid", "size": [size] * 3, "rest_distance": D}, "method": METHOD | method})


def solver_of(scene: Scene, position: np.ndarray) -> DivergenceFree:
    world = _World(scene)
    place = np.pad(position, ((0, 0), (0, 3 - scene.dimensions)))
    return DivergenceFree(world, 0, place, _Pairs(world, place), _places(world, place))


def stirred(scene: Scene, seed: int = 3) -> tuple[DivergenceFree, np.ndarray]:
    """(a solver where particles are a little off their lattice, velocities at random)."""
    random = np.random.default_rng(seed)
    place = scene.fluid_set.position
    return (
        solver_of(scene, place + random.uniform(-0.1, 0.1, place.shape) * D),
        random.normal(0, 1, (len(place), 3)),
    )


def objective(solver: DivergenceFree, target: np.ndarray, multiplier: np.ndarray) -> float:
    """What an exact solve makes least of all multipliers that are not positive: m . target + m . A m / 2."""
    return float(multiplier @ target + multiplier @ solver.rate(solver.moved_by(multiplier)) / 2)


@pytest.mark.parametrize("axes", [2, 3])
def test_density_grows_as_continuity_says(axes: int) -> None:
    """d rho / dt = -rho div v: of v = -x, `axes` a second inside, to rounding, as slopes are scaled so; of a rotation 0."""
    water = {"kind": "fluid", "dimensions": axes, "size": [9 * D] * axes, "rest_distance": D}
    solver = solver_of(scene := Scene({"water": water, "method": METHOD}), scene.fluid_set.position)
    x = np.pad(scene.fluid_set.position, ((0, 0), (0, 3 - axes))) - 4.5 * D * (np.arange(3) < axes)
    inside = np.abs(x).max(axis=1) < 2 * D
    assert inside.sum() == 3**axes
    assert solver.rate(-x)[inside] == pytest.approx(axes, abs=1e-12)
    assert np.abs(solver.rate(np.cross([0.0, 0.0, 1.0], x))[inside]).max() < 1e-12


def test_the_first_solve_takes_compression_away_and_makes_no_energy() -> None:
    """It projects onto velocities that press nothing: of all iterations the objective, by which kinetic energy changes, is
    not above 0, where it begins; solved to the end, nobody inside becomes denser (1e-6 of what did)."""
    before = None
    for iterations in (1, 5, 400):
        solver, velocity = stirred(drop(iterations=iterations))
        target = np.where(solver.c > -1 / 8, solver.h * solver.rate(velocity), -1.0)
        found, multiplier = solver.solve(target, velocity)
        assert objective(solver, target, multiplier) < 0 and multiplier.max() <= 0
        assert (found**2).sum() < (velocity**2).sum()
        before = target.max()
    left = solver.h * solver.rate(found)[solver.c > -1 / 8]
    assert left.max() < 1e-6 * before


def test_momentum_is_what_pairs_exchange() -> None:
    solver, velocity = stirred(drop())
    found, _ = solver.substep(velocity, lambda v, c: v)
    assert np.abs((found - velocity).sum(axis=0)).max() < 1e-12 * np.abs(velocity).sum()


def test_iterations_converge_as_theory_says() -> None:
    """Of a bar squeezed along its length: after k accelerated iterations the objective is above its least by 2 |m|^2 /
    (k + 1)^2 at most (A. Beck and M. Teboulle 2009, theorem 4.4), |m|^2 = sum m^2 / factor of the solution m: the steps, half
    of Jacobi's, are short enough. Without acceleration more is left of a push that has 20 layers to go through."""
    water = {"kind": "fluid", "size": [3 * D, 20 * D, 3 * D], "rest_distance": D}
    scene = Scene({"water": water, "method": METHOD})
    place = scene.fluid_set.position * [1.0, 0.98, 1.0]
    solver, nothing = solver_of(scene, place), np.zeros((len(place), 3))

    def after(k: int) -> np.ndarray:
        solver.iterations = k
        return solver.solve(solver.c, nothing)[1]

    best = after(4000)
    least, size = objective(solver, solver.c, best), float((best**2 / solver.factor).sum())
    plain, compared = np.zeros(len(place)), []
    for k in range(1, 33):
        plain = np.minimum(plain - solver.factor * (solver.c + solver.rate(solver.moved_by(plain))), 0)
        if k in (4, 8, 16, 32):
            over = objective(solver, solver.c, after(k)) - least
            assert 0 < over <= 2 * size / (k + 1) ** 2
            compared.append(over / (objective(solver, solver.c, plain) - least))
    assert max(compared) < 1, compared


def test_where_iterations_start_from() -> None:
    f = plain_formulas(divergence, float)
    assert [f.lead(k, 4) for k in range(4)] == [0.0, 1 / 4, 2 / 5, 0.0]
    assert f.led(-2.0, -1.0, 0.5) == -2.5 and f.pressed(-1.0, 2.0, 0.25) == -1.5 and f.pressed(0.0, 2.0, -1.0) == 0.0
    assert f.compressed(-0.2, 9.0, 0.1, 9.0) == -1.0 and f.compressed(-0.08, 3.0, 0.1, 0.25) == pytest.approx(0.55)


def test_a_lattice_without_weight_stays() -> None:
    scene = free(column_scene(**{"gravity.enabled": False}))
    place = scene.fluid_set.position
    start = replace(shaken(scene), position=place, velocity=np.zeros_like(place))
    end = ends(scene, 2, start, math="exact", precision="float64")
    assert np.abs(end.position - place).max() < 1e-3 * D


def test_a_wall_that_comes_on_takes_what_is_at_rest_along() -> None:
    """Its first solve sees how it comes: what the wall adds to density in a substep, by its gradient, which is scaled apart
    (by 5 %) and less at the substep's begin (by 4 * 2 mm / 0.725 supports = 13 %, half of it on the mean); nothing where no
    wall is near."""
    wall = {"kind": "plane", "normal": [1.0, 0.0, 0.0], "velocity": [0.5, 0.0, 0.0], "thickness": 0.0}
    scene = Scene({"water": {"kind": "fluid", "size": [4 * D] * 3, "rest_distance": D}, "wall": wall, "method": METHOD})
    solver = solver_of(scene, scene.fluid_set.position)
    layer = scene.fluid_set.position[:, 0] < D
    slope = solver.wall[layer, 0]
    assert solver.came[layer] == pytest.approx(-slope * 0.5 * solver.h, rel=0.12) and solver.came[layer].min() > 0
    assert np.abs(solver.came[scene.fluid_set.position[:, 0] > 2 * D]).max() == 0
    found, multiplier = solver.substep(np.zeros((len(layer), 3)), lambda v, c: v)
    pressed = layer & (solver.c > -1 / 8)
    assert pressed.sum() == 12 and found[pressed, 0].min() > 0 and multiplier[pressed].max() < 0


def test_what_is_told_and_refused() -> None:
    scene = drop()
    told = family_of(scene).note(scene)
    assert "5 iterations for their divergence and as many for the density to come" in told
    assert [stage.name for stage in family_of(scene).plan(scene).root.stages()].count("relax") == 4 * 2 * 5
    assert scene.method.name == "pbf divergence-free" and scene.method.relaxation_factor == 0.5
    with pytest.raises(SceneError, match=r"method\.tensile_correction .* applies to the schemes macklin and averaged"):
        drop(tensile_correction=0.001)
