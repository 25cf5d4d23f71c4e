"""Fluids on CPU threads: the judge's motion, the same bits whoever computes them, and lists that tell what they lack."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fluid_scenes import SCENES, D, column_scene, ends, shaken

from softlab.app.driver import open_simulation
from softlab.bench.reference.fluid import run, simulate
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.fluid.measure import differences
from softlab.model.fluid.parameters import MAX_NEIGHBOURS
from softlab.model.scene.scene import Scene

EXACT = {"math": "exact", "precision": "float64"}


@pytest.mark.parametrize("name", SCENES)
def test_against_the_judge_and_the_same_bits(name: str) -> None:
    """Within rounding of plain NumPy; to the bit on any number of threads, stage by stage, and from a state on the way."""
    scene = SCENES[name]()
    start = shaken(scene)
    fused = ends(scene, 2, start, threads=2, **EXACT)
    position, velocity = simulate(scene, 2, start.position, start.velocity)
    assert np.abs(fused.position - position).max() < 1e-13
    assert np.abs(fused.velocity - velocity).max() < 1e-11 * max(1.0, np.abs(velocity).max())
    halfway = ends(scene, 1, start, kernel="stages", threads=1, **EXACT)
    staged = ends(scene, 1, halfway, kernel="stages", threads=3, **EXACT)
    for field in ("position", "velocity"):
        assert np.array_equal(getattr(fused, field), getattr(staged, field))


def test_particles_keep_their_numbers_and_lists_hold_all_neighbours() -> None:
    scene = column_scene()
    start = shaken(scene)
    with open_simulation(scene, initial=replace(start), threads=2, **EXACT) as simulation:
        assert np.array_equal(simulation.read("position"), start.position)
        simulation.advance(1)
        world = simulation._world  # type: ignore[attr-defined]
        count, cell, order = world.sizes.particles, world.table.cell, world.table.order
        number, neighbours, entries = world.state.number[:count], world.lists.neighbours[:count], world.lists.entries
        assert sorted(number) == list(range(count))
        key = cell[order[:count]]
        assert (np.diff(key) >= 0).all() and (np.diff(number)[np.diff(key) == 0] > 0).all()
        most, found = MAX_NEIGHBOURS[3], set()
        for i in range(count):
            own = entries[i // 16 * 16 * most + i % 16 :: 16][: neighbours[i]]
            found |= {(int(number[i]), int(number[j])) for j in own}
        assert simulation.contacts_lost == 0  # type: ignore[attr-defined]
    assert all((j, i) in found for i, j in found)


def test_lists_are_those_of_all_pairs() -> None:
    """At a start without gravity and speed, where predicted places are the given ones."""
    scene = column_scene(**{"gravity.enabled": False, "method.iterations": 1, "method.substeps": 1})
    start = replace(shaken(scene), velocity=np.zeros_like(shaken(scene).velocity))
    with open_simulation(scene, initial=start, threads=1, **EXACT) as simulation:
        simulation.advance(1)
        world = simulation._world  # type: ignore[attr-defined]
        count = world.sizes.particles
        told = np.empty(count, int)
        told[world.state.number[:count]] = world.lists.neighbours[:count]
    pairs, _ = differences(scene, start.position)
    assert np.array_equal(told, np.bincount(pairs.ravel(), minlength=count))


def test_what_lists_cannot_hold_is_told() -> None:
    scene = column_scene()
    start = shaken(scene)
    squeezed = replace(start, position=start.position * [0.3, 0.3, 0.3])
    with open_simulation(scene, initial=squeezed, threads=1) as simulation:
        simulation.advance(1)
        assert simulation.contacts_lost > 100  # type: ignore[attr-defined]


def test_a_particle_far_away_takes_nothing_from_the_others() -> None:
    """The table's cells become larger, and everyone is found as before."""
    scene = column_scene()
    start = shaken(scene)
    start.position[-1] = [0.1, 40.0, 0.1]
    found = ends(scene, 1, start, **EXACT)
    position, _ = simulate(scene, 1, start.position, start.velocity)
    assert np.abs(found.position - position).max() < 1e-12


def test_momentum_is_kept_without_walls() -> None:
    """Fluids of two densities that push, draw and smooth each other: 1e-5 in float32 of what moves."""
    tables = SCENES["two fluids"]().as_dict()
    scene = Scene({name: tables[name] for name in ("water", "oil", "method")}).replace(
        {"water.maximum_acceleration": None}
    )
    start = shaken(scene)
    found = ends(scene, 3, start, precision="float32", math="fast")
    mass = scene.fluid_set.masses[:, None]
    before, after = (np.sum(mass * state.velocity.astype(float), axis=0) for state in (start, found))
    assert np.abs(after - before).max() < 1e-5 * np.sum(mass * np.abs(start.velocity))


def test_speeds_and_accelerations_have_their_limits() -> None:
    """Half a support a substep, whatever comes; a lone particle falls as it would."""
    scene = column_scene()
    start = replace(shaken(scene), velocity=np.full((144, 3), 1000.0))
    fastest = 0.5 * scene.fluid_set.support * 2 * 60
    found = ends(scene, 1, start, **EXACT)
    assert np.linalg.norm(found.velocity, axis=1).max() <= fastest * (1 + 1e-12)
    lone = Scene(
        {"water": {"kind": "fluid", "size": [D, D, D]}, "gravity": {}, "method": column_scene().as_dict()["method"]}
    )
    fallen = ends(lone, 3, shaken(lone), **EXACT)
    assert fallen.velocity[0, 1] - shaken(lone).velocity[0, 1] == pytest.approx(-9.81 * 3 / 60, rel=1e-12)


def test_live_fields_and_pressures() -> None:
    scene = column_scene()
    with open_simulation(scene, live=("gravity", "poke"), **EXACT) as simulation:
        simulation.advance(2)
        _, _, _, pressure = run(scene, 2, scene.fluid_set.position, scene.fluid_set.velocity)
        assert simulation.read("pressure").max() == pytest.approx(pressure.max(), rel=0.05)
        assert simulation.read("strain").shape == (144,)
        simulation.set("gravity.enabled", False)
        simulation.poke(0, (0.0, 10.0, 0.0))
        simulation.advance(1)
        with pytest.raises(SceneError, match="normal"):
            simulation.read("normal")
        with pytest.raises(SceneError, match="water"):
            simulation.set("water.viscosity", 1.0)


def test_what_is_no_number_is_found() -> None:
    scene = column_scene()
    with open_simulation(scene, **EXACT) as simulation:
        simulation._state.velocity[7] = np.nan  # type: ignore[attr-defined]
        with pytest.raises(Diverged):
            simulation.advance(1)
            simulation.check()


def test_a_gpu_is_refused_in_one_line_until_it_knows_fluids() -> None:
    from softlab.model.core.families import family_of

    if "gpu" in family_of(column_scene()).solvers:
        pytest.skip("it knows them")
    with pytest.raises(SceneError, match=r"^backend = 'gpu': does not know a fluid yet; use cpu"):
        open_simulation(column_scene(), "gpu")
