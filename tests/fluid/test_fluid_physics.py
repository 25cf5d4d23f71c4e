"""Fluids against what is known of them: a column at rest, a dam that breaks, Taylor and Green's vortices, a drop.

Minutes of processor time and compiled kernels: behind --rest. NUMERICS section F.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.fluid.measure import differences
from softlab.model.fluid.parameters import MAX_NEIGHBOURS
from softlab.model.particles.fluid_set import vortices
from softlab.model.scene.scene import Scene, load_scene

G, RHO, HEIGHT, D = 9.81, 1000.0, 1.0, 0.05
FREE = {"method.scheme": "divergence-free"}
HOW: dict[str, Any] = {"precision": "float32", "math": "fast"}
# Martin and Moyce 1952, table 2, n^2 = 2: (t sqrt(2 g / a), front / a)
FRONT = np.array(
    [
        (0.41, 1.11), (0.84, 1.22), (1.19, 1.44), (1.43, 1.67), (1.63, 1.89), (1.83, 2.11), (1.98, 2.33), (2.20, 2.56),
        (2.32, 2.78), (2.51, 3.00), (2.65, 3.22), (2.83, 3.44), (2.98, 3.67), (3.11, 3.89), (3.33, 4.11),
    ]
)  # fmt: skip


def column_at_rest(scene: Scene, seconds: float = 3.0, looks: int = 30) -> dict[str, float]:
    """Of the last `looks` steps: the mean height over that at rest; the mean and the largest of what density constraints
    exceed 0 by; the largest speed over sqrt(g H), its mean over steps; and the largest error of the pressure over rho g
    H, in bins of a support's height, below the free surface."""
    heights, speeds, over, places, pressures = [], [], [], [], []
    with open_simulation(scene, **HOW) as simulation:
        simulation.advance(round(seconds / scene.method.dt) - looks)
        for _ in range(looks):
            simulation.advance(1)
            state = simulation.state()
            y = state.position[:, 1].astype(np.float64)
            heights.append(np.sort(y)[-36:].mean() + D / 2)
            speeds.append(np.linalg.norm(state.velocity, axis=1).max())
            over.append(np.maximum(simulation._by_number(simulation._world.work.error), 0))  # type: ignore[attr-defined]
            places.append(y)
            pressures.append(simulation.read("pressure"))
    place, pressure = np.concatenate(places), np.concatenate(pressures)
    layer = np.floor(place / (2 * D)).astype(int)
    wanted = RHO * G * (HEIGHT - place)
    bins = [(pressure - wanted)[layer == k] for k in range(round(HEIGHT / (2 * D)) - 1)]
    errors = [abs(one.mean()) for one in bins if len(one)]
    return {
        "height": float(np.mean(heights)) / HEIGHT,
        "mean": float(np.mean(over)),
        "largest": float(np.max(over)),
        "speed": float(np.mean(speeds)) / np.sqrt(G * HEIGHT),
        "pressure": max(errors) / (RHO * G * HEIGHT),
    }


@pytest.mark.parametrize(
    "changes",
    [{}, FREE | {"method.iterations": 5}, FREE | {"method.iterations": 10}],
    ids=["macklin", "free-5", "free-10"],
)
def test_a_column_at_rest_all_at_once(changes: dict[str, Any]) -> None:
    """F1, with 8 substeps x 10 iterations a sixtieth of a second and 120 Pa s: height 1 +- .01, density error < 1 %
    on the mean and < 3 % anywhere, largest speed < 1 % of sqrt(g H), pressure rho g z within 3 %. 5 iterations of each
    solve of `divergence-free` do as well as 10."""
    found = column_at_rest(load_scene("column").replace(changes))
    assert abs(found["height"] - 1) < 0.01, found
    assert found["mean"] < 0.01 and found["largest"] < 0.03, found
    assert found["speed"] < 0.01 and found["pressure"] < 0.03, found


def test_the_averaged_scheme_lets_a_column_sink() -> None:
    """F1: to .608 of its height with 3 iterations and 2 substeps."""
    changes = {"method.scheme": "averaged", "method.substeps": 2, "method.iterations": 3, "water.viscosity": 4.5}
    assert column_at_rest(load_scene("column").replace(changes))["height"] == pytest.approx(0.608, abs=0.02)


def dam(across: int, viscosity: float) -> Scene:
    """Of a = .05715 m and twice the height, in the plane."""
    a = 0.05715
    wall = {"kind": "plane", "thickness": 0.0}
    return Scene(
        {
            "water": {
                "kind": "fluid", "dimensions": 2, "size": [a, 2 * a], "rest_distance": a / across, "viscosity": viscosity,
            },
            "floor": wall,
            "left": wall | {"normal": [1.0, 0.0, 0.0]},
            "gravity": {},
            "method": {"solver": "pbf", "dt": 0.002, "substeps": 4, "iterations": 5},
        }
    )  # fmt: skip


@pytest.mark.parametrize(("changes", "mean"), [({}, 0.035), (FREE, 0.036)], ids=["macklin", "free"])
def test_the_front_of_a_dam_that_breaks(changes: dict[str, Any], mean: float) -> None:
    """F2, shifted once in time, as the gate opens slowly: 6.4 % at the worst point, which is the first, 3.1 % on the mean
    (6.6 % and 3.3 % by `divergence-free`): the table's own first step is none that gravity makes (docs/method/fluids.md)."""
    scene, a = dam(20, 0.5).replace(changes), 0.05715
    time, front = [0.0], [1.0]
    with open_simulation(scene, **HOW) as simulation:
        for _ in range(110):
            simulation.advance(1)
            time.append(simulation.time * np.sqrt(2 * G / a))
            front.append((simulation.read("position")[:, 0].max() + a / 40) / a)
    shifts = np.linspace(-0.3, 0.3, 121)
    errors = np.array([np.abs(np.interp(FRONT[:, 0] - shift, time, front) / FRONT[:, 1] - 1) for shift in shifts])
    best = errors[np.argmin(errors.max(axis=1))]
    assert best.max() < 0.07 and best.mean() < mean, (best.max(), best.mean())


def viscosity_of(scene: Scene, seconds: float = 0.5) -> float:
    """[m^2/s] by which Taylor and Green's wave in a scene slows down, once the lattice is no more: its energy goes as
    exp(-16 pi^2 nu t)."""
    times, energy = [], []
    with open_simulation(scene, **HOW) as simulation:
        for _ in range(round(seconds / scene.method.dt)):
            state = simulation.state()
            wave = vortices(state.position.astype(np.float64), scene.domain)  # type: ignore[arg-type]
            energy.append(((state.velocity * wave).sum() / (wave * wave).sum()) ** 2)
            times.append(simulation.time)
            simulation.advance(1)
        drift = np.abs(simulation.read("velocity").mean(axis=0)).max()
    assert drift < 1e-4
    begin = sum(time < 0.05 for time in times)
    return float(-np.polyfit(times[begin:], np.log(energy[begin:]), 1)[0] / (16 * np.pi**2))


def test_the_numerical_viscosity_of_taylor_and_greens_vortices() -> None:
    """At 1 m/s in a box of 1 m the method itself makes about .0124 m^2/s with particles 2 cm apart, .0029 at 1 cm: it falls
    with the square of their distance (within a factor of 1.3). To 10 Pa s, which is .01, it does not simply add: together
    they make .076 and .020."""
    viscous = load_scene("taylor-green")
    scene = viscous.replace({"water.viscosity": 0.0})
    fine = {"water.rest_distance": 0.01}
    coarse = viscosity_of(scene)
    assert 0.010 < coarse < 0.015
    assert viscosity_of(scene.replace(fine)) < coarse / 4 * 1.3
    assert 0.06 < viscosity_of(viscous) < 0.095
    assert 0.016 < viscosity_of(viscous.replace(fine)) < 0.024


def test_viscosity_is_that_of_a_shear_wave() -> None:
    """Where no pressure acts: v_y = U sin(2 pi x) slows down at nu (2 pi)^2, what XSPH is told, within 10 %."""
    scene = load_scene("taylor-green").replace({"water.vortices": 0.0, "water.viscosity": 10.0})
    times, size = [], []
    with open_simulation(scene, **HOW) as simulation:
        start = simulation.state()
        velocity = np.zeros_like(start.velocity)
        velocity[:, 1] = 0.1 * np.sin(2 * np.pi * start.position[:, 0])
        simulation.load(replace(start, velocity=velocity))
        for _ in range(30):
            state = simulation.state()
            size.append((state.velocity[:, 1] * np.sin(2 * np.pi * state.position[:, 0])).mean())
            times.append(simulation.time)
            simulation.advance(1)
    rate = -np.polyfit(times, np.log(size), 1)[0]
    assert rate / (2 * np.pi) ** 2 == pytest.approx(0.01, rel=0.1)


def test_a_drop_stays_where_it_is_and_becomes_round() -> None:
    """Without gravity, drawn together by cohesion and surface tension: its middle does not drift, its corners go."""
    water = {"kind": "fluid", "size": [0.4, 0.4, 0.4], "viscosity": 5.0, "cohesion": 5.0, "surface_tension": 0.1}
    scene = Scene({"water": water, "method": {"solver": "pbf", "dt": 1 / 60, "substeps": 4, "iterations": 5}})
    with open_simulation(scene, **HOW) as simulation:
        start = simulation.state().position.astype(np.float64)
        simulation.advance(120)
        state = simulation.state()
    end = state.position.astype(np.float64)
    assert np.abs(end.mean(axis=0) - start.mean(axis=0)).max() < 1e-3 * D

    def farthest(position: np.ndarray) -> float:
        away = np.linalg.norm(position - position.mean(axis=0), axis=1)
        return float(away.max() / np.sqrt(np.mean(away**2)))

    assert farthest(end) < 0.9 * farthest(start)


def test_moving_walls_are_not_passed() -> None:
    """A box of walls that moves as fast as nothing in it may: all water stays inside, and goes along."""
    wall = {"kind": "plane", "thickness": 0.0, "velocity": [1.0, 0.0, 0.0]}
    tables: dict[str, Any] = {
        "water": {"kind": "fluid", "size": [0.3, 0.3, 0.3], "viscosity": 5.0},
        "floor": wall | {"velocity": [0.0, 0.0, 0.0]},
        "left": wall | {"normal": [1.0, 0.0, 0.0]},
        "right": wall | {"normal": [-1.0, 0.0, 0.0], "point": [0.3, 0.0, 0.0]},
        "back": wall | {"normal": [0.0, 0.0, 1.0]},
        "front": wall | {"normal": [0.0, 0.0, -1.0], "point": [0.0, 0.0, 0.3]},
        "gravity": {},
        "method": {"solver": "pbf", "dt": 1 / 60, "substeps": 4, "iterations": 5},
    }
    with open_simulation(Scene(tables), **HOW) as simulation:
        simulation.advance(90)
        state = simulation.state()
    x = state.position[:, 0] - simulation.time
    assert x.min() > -1e-3 and x.max() < 0.301 and state.position[:, 1].min() > -1e-3
    assert state.velocity[:, 0].mean() == pytest.approx(1.0, abs=0.1)


def test_lists_of_thousands_in_one_place_are_told() -> None:
    """What does not fit into the room for a cell's neighbours is looked at in parts: none is missed or told twice."""
    water = {"kind": "fluid", "size": [0.6, 0.6, 0.6], "rest_distance": D}
    method = {"solver": "pbf", "dt": 1 / 60, "substeps": 1, "iterations": 1}
    scene = Scene({"water": water, "method": method})
    with open_simulation(scene, precision="float64", math="exact") as simulation:
        start = simulation.state()
        random = np.random.default_rng(3).uniform(0, 0.15, start.position.shape)
        simulation.load(replace(start, position=random))
        simulation.advance(1)
        lost = simulation.contacts_lost  # type: ignore[attr-defined]
        assert np.isfinite(simulation.read("position")).all()
    pairs, _ = differences(scene, random)
    neighbours = np.bincount(pairs.ravel(), minlength=len(random))
    assert neighbours.min() > 100 and lost == np.maximum(neighbours - MAX_NEIGHBOURS[3], 0).sum()


def test_a_wall_that_comes_at_a_hundred_metres_a_second() -> None:
    """Faster than anything may be: it takes all water along, nothing passes it, and the speed limit holds."""
    tables: dict[str, Any] = {
        "water": {"kind": "fluid", "size": [0.3, 0.3, 0.3], "viscosity": 5.0},
        "wall": {"kind": "plane", "normal": [1.0, 0.0, 0.0], "point": [-0.5, 0.0, 0.0], "velocity": [100.0, 0.0, 0.0]},
        "method": {"solver": "pbf", "dt": 1 / 60, "substeps": 4, "iterations": 5},
    }
    scene = Scene(tables)
    with open_simulation(scene, **HOW) as simulation:
        simulation.advance(6)
        state = simulation.state()
    assert (state.position[:, 0] > 100 * state.time - 0.5).all()
    fastest = 0.5 * scene.fluid_set.support * 4 * 60
    assert np.linalg.norm(state.velocity, axis=1).max() <= fastest * (1 + 1e-5)


# ---------------------------------------------------------------------- the scheme `divergence-free`


def test_density_error_falls_with_the_squares_of_iterations_and_substeps() -> None:
    """Pressures begin at 0 in each substep, so that a column rests where g h^2 is what iterations take away of a push that
    grows with its depth: the error goes as h^2, and, as they are accelerated, as 1 / k^2 (within a factor of 1.6)."""

    def mean(substeps: int, iterations: int) -> float:
        changes = {"method.substeps": substeps, "method.iterations": iterations, "water.viscosity": 27.0}
        return column_at_rest(load_scene("column").replace(FREE | changes), seconds=1.5)["mean"]

    few, often, long = mean(4, 5), mean(8, 5), mean(4, 10)
    assert 4 / 1.6 < few / often < 4 * 1.6, (few, often)
    assert 4 / 1.6 < few / long < 4 * 1.6, (few, long)


def still(scene: Scene) -> tuple[float, float]:
    """(kinetic energy after half a second, the largest on the way), of that at the start, of vortices without viscosity."""
    with open_simulation(scene, **HOW) as simulation:
        start = vortices(scene.fluid_set.position, scene.domain)  # type: ignore[arg-type]
        energies = []
        for _ in range(50):
            simulation.advance(1)
            energies.append(float((simulation.read("velocity").astype(float) ** 2).sum() / (start**2).sum()))
    return energies[-1], max(energies)


def test_vortices_slow_down_by_the_methods_own_viscosity() -> None:
    """At 1 m/s in a box of 1 m about .027 m^2/s with particles 2 cm apart, .0057 at 1 cm: it falls with the square of their
    distance (within a factor of 1.3); and nothing makes energy."""
    scene = load_scene("taylor-green").replace(FREE | {"water.viscosity": 0.0})
    coarse = viscosity_of(scene)
    assert 0.016 < coarse < 0.034
    assert viscosity_of(scene.replace({"water.rest_distance": 0.01})) < coarse / 4 * 1.3
    last, largest = still(scene)
    assert 0.02 < last < 1 and largest < 1 + 1e-3
