"""Vessels: what a cup pours stays, a cup that stands keeps its water, a splash of the lab's water makes no energy.

Minutes of processor time: behind --rest, but for what needs no run.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.bench.experiments.vessels import basin_area, in_basin, in_cup, pouring
from softlab.model.fluid.measure import compression
from softlab.model.scene.scene import load_scene

HOW: dict[str, Any] = {"precision": "float32", "math": "fast"}
G = 9.81


def test_what_is_in_a_vessel() -> None:
    """At the start all of it in the cup, none in the basin; turned with it."""
    scene = load_scene("pour")
    cup: Any = scene.parts["cup"]
    position = scene.fluid_set.position
    assert in_cup(cup, position, 0.0).all() and not in_basin(scene, position).any()
    middle, quarter = np.array([cup.origin]), np.pi / 2 / 0.9
    beside = middle + np.array([[0.13, 0.0, 0.0]])
    assert in_cup(cup, middle, quarter).all()
    assert in_cup(cup, beside, quarter).all() and not in_cup(cup, beside, 0.0).any()
    assert in_basin(scene, np.array([[0.24, 0.01, 0.0]])).all()
    assert not in_basin(scene, np.array([[0.24, 0.2, 0.0], [0.5, 0.01, 0.0], [0.24, 0.01, 0.2]])).any()


def test_what_a_cup_pours_stays_in_the_basin() -> None:
    """While it tips, then all but a hundredth, which splashes over the rim; under no floor, and through no wall: nobody
    lies on the floor beside the basin but who left over a rim. In the end it stands as high as its volume over the basin's
    area, to half a rest distance, of which a layer is one."""
    scene = load_scene("pour")
    found, shares = scene.fluid_set, []
    for time, cup, basin, position in pouring(scene, threads=2):
        shares.append((time, cup, basin))
        assert position[:, 1].min() > -1e-5
        assert cup + basin > 0.99 or 1.2 < time < 3.0  # else some of it is on its way
    time, cup, basin = np.array(shares).T
    assert cup[0] > 0.999 and (np.diff(basin) > -0.005).all() and basin[-1] > 0.99
    poured = position[in_basin(scene, position)]
    level = len(poured) * found.lattice.volume / basin_area(scene, 0.002)
    assert 2 * poured[:, 1].mean() == pytest.approx(level, abs=found.spacing / 2)
    assert compression(scene, position)[0] < 0.01


def test_a_splash_makes_no_energy_and_no_jets_beyond_its_fall() -> None:
    """Where falling water closes on the floor, jets leave at several times the speed that it fell with, all the faster the
    finer the substeps are, while the whole loses energy: the scene holds them back to what a fall from the water's top
    gives."""
    scene = load_scene("lab-water")
    top, floor = float(scene.fluid_set.position[:, 1].max()), scene.parts["floor"].point[1]  # type: ignore[attr-defined]
    (most,) = (part.maximum_speed for part in scene.fluids.values())
    assert most == pytest.approx(np.sqrt(2 * G * (top - floor)), rel=0.01)
    fastest, energies = {}, []
    for held in (True, False):
        with open_simulation(
            scene if held else scene.replace({"water.maximum_speed": None}), threads=1, **HOW
        ) as simulation:
            speeds = []
            for _ in range(16):
                simulation.advance(10)
                speeds.append(float(np.linalg.norm(simulation.read("velocity"), axis=1).max()))
                energies.append(simulation.energies()["total"] if held else energies[-1])
            fastest[held] = max(speeds)
    assert fastest[True] <= most * (1 + 1e-6) and fastest[False] > 1.5 * most
    whole = G * scene.fluid_set.masses.sum() * (top - floor)
    assert np.diff(energies).max() < 1e-3 * whole
