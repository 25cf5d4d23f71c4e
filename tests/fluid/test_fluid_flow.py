"""Emitters and sinks on CPU threads: the judge's motion, the same bits whoever computes them, what is told, what is
refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flow_scenes import DRAIN, FLOWS, TAP, flat_tap, tap_scene
from fluid_scenes import METHOD, D

from softlab.app.driver import open_simulation
from softlab.app.output.files import read_state, write_state
from softlab.bench.reference.fluid import simulate
from softlab.model.base.errors import InputError, SceneError
from softlab.model.core.state import State
from softlab.model.fluid.flow import rates
from softlab.model.geometry.particle_row import PARKED
from softlab.model.scene.scene import Scene

EXACT: dict[str, Any] = {"math": "exact", "precision": "float64"}
STEPS = 6


def end_of(scene: Scene, steps: int, initial: State | None = None, **how: Any) -> State:
    with open_simulation(scene, initial=initial, **EXACT | how) as simulation:
        simulation.advance(steps)
        return simulation.state()


def same(a: State, b: State) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ("position", "velocity", "inverse_mass"))


@pytest.mark.parametrize("name", FLOWS)
def test_against_the_judge_and_the_same_bits(name: str) -> None:
    """Within rounding of plain NumPy, the same particles waiting; to the bit on any number of threads, stage by stage, and
    from a state on the way. Some came, some went."""
    scene = FLOWS[name]()
    fused, found = end_of(scene, STEPS, threads=2), scene.fluid_set
    position, velocity = simulate(scene, STEPS, found.position, found.velocity)
    there = found.there(position)
    assert np.array_equal(found.there(fused.position), there) and np.array_equal(fused.inverse_mass > 0, there)
    assert np.abs(fused.position - position).max() < 1e-12
    assert np.abs(fused.velocity - velocity).max() < 1e-10
    halfway = end_of(scene, STEPS // 2, kernel="stages", threads=1)
    assert same(end_of(scene, STEPS - STEPS // 2, halfway, kernel="stages", threads=3), fused)
    assert not np.array_equal(halfway.inverse_mass > 0, there)


def test_some_end_and_are_given_again() -> None:
    """What a sink takes waits, has no weight and no speed, and comes again: more leave the nozzle than there is room for."""
    scene = tap_scene(**{"drain.center": [0.2, 0.0, 0.1], "drain.half_size": [0.25, 0.15, 0.4], "water.viscosity": 0.0})
    with open_simulation(scene, **EXACT) as simulation:
        simulation.advance(30)
        state = simulation.state()
        left = rates(scene, "tap")[1] * 0.5
        assert left > 90 and simulation.not_emitted < left / 2  # type: ignore[attr-defined]
        waits = state.inverse_mass == 0
        assert waits.any() and (state.position[waits] == PARKED).all() and not state.velocity[waits].any()
        energy = simulation.energies()
        mass = scene.fluid_set.masses[~waits]
        assert energy["gravity"] == pytest.approx(9.81 * np.sum(mass * state.position[~waits, 1]), rel=1e-12)


def test_a_jet_has_its_layers_where_they_should_be() -> None:
    """Without weight, n layers have left when the time times the speed is more than n - 1 rest distances, in discs of the
    nozzle's points, a rest distance apart, which begin as far before it as a substep goes at most; what left is rate times
    time, and no pair is nearer than on the lattice."""
    scene = Scene({
        "water": {"kind": "fluid", "rest_distance": D, "capacity": 400}, "tap": TAP, "method": METHOD,
    })  # fmt: skip
    state = end_of(scene, 9)
    there = scene.fluid_set.there(state.position)
    volume, each_second, points = rates(scene, "tap")
    time = 9 / 60
    assert points == 5 and there.sum() == points * (int(each_second / points * time) + 1)
    assert volume == pytest.approx(points * scene.fluid_set.lattice.volume * 2.4 / D)
    below = (0.35 - state.position[there, 1]) / D
    wanted = 2.4 * (time + 1 / 120) / D - np.repeat(np.arange(there.sum() // points), points)
    assert np.sort(below) == pytest.approx(np.sort(wanted), abs=0.02)


def test_capacity_is_told() -> None:
    """As many as were due and did not come, to the particle."""
    scene = tap_scene()
    with open_simulation(scene, **EXACT) as simulation:
        simulation.advance(STEPS)
        state = simulation.state()
        side = scene.emitters["side"]
        layers = int(np.ceil(2.0 / D * (0.055 - 0.01)))
        due = layers * len(side.nozzle(D, 3))
        oil = state.inverse_mass[90:] > 0
        assert due > 8 and simulation.not_emitted == due - 8 and oil.sum() <= 8  # type: ignore[attr-defined]


def test_a_tap_is_turned_while_it_runs(tmp_path: Path) -> None:
    """No layer is lost or doubled where it is, states carry it, in memory and as a file; one that is shut gives nothing."""
    scene = tap_scene(**{"water.capacity": 200, "side.speed": 0.0})
    with open_simulation(scene, live=("taps",), **EXACT) as simulation:
        simulation.advance(3)
        simulation.set("tap.speed", 1.2)
        simulation.advance(2)
        kept = simulation.state()
        simulation.advance(3)
        whole = simulation.state()
        simulation.load(kept)
        simulation.advance(3)
        assert same(simulation.state(), whole)
        gone = 2.4 * 3 / 60 + 1.2 * 5 / 60
        assert (whole.inverse_mass[32:200] > 0).sum() == 5 * int(np.ceil(gone / D - 1e-9))
        simulation.set("tap.speed", 0.0)
        simulation.advance(4)
        assert (simulation.state().inverse_mass[32:200] > 0).sum() <= (whole.inverse_mass[32:200] > 0).sum()
        with pytest.raises(SceneError, match=r"must be at most 5\.455 m/s"):
            simulation.set("tap.speed", 9.0)
    slow = scene.replace({"tap.speed": 1.2})
    write_state(tmp_path / "kept.npz", kept)
    assert same(end_of(slow, 3, read_state(tmp_path / "kept.npz", slow)), whole)
    with open_simulation(scene, **EXACT) as simulation, pytest.raises(SceneError, match="not live"):
        simulation.set("tap.speed", 1.0)
    with open_simulation(scene, **EXACT) as simulation, pytest.raises(InputError, match="taps has shape"):
        simulation.load(replace(kept, taps=np.zeros(3)))


def test_rewind_and_reset_take_back_what_came() -> None:
    with open_simulation(flat_tap(), threads=2, **EXACT) as simulation:
        simulation.advance(3)
        first = simulation.state()
        simulation.advance(5)
        simulation.rewind()
        assert same(simulation.state(), first)
        simulation.reset()
        assert not simulation.state().inverse_mass.any()
        simulation.advance(3)
        assert same(simulation.state(), first)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"water.capacity": 31},
            r"^water.*capacity.*must be at least what it starts with, 32 particles",
        ),
        ({"water.capacity": 0}, r"^water\.capacity = 0: must be at least 1"),
        ({"tap.speed": float("nan")}, r"^tap\.speed = nan: must be"),
        ({"tap.speed": -1.0}, r"^tap\.speed = -1.0: must be at least 0"),
        ({"tap.speed": 6.0}, r"^tap\.speed = 6.0: must be at most 5.455 m/s, half a support a substep"),
        ({"tap.radius": 0.02}, r"^tap\.radius = 0.02: is narrower than the rest distance, 0.05 m: use at least 0.025"),
        ({"side.size": [0.04, 0.2]}, r"^side\.size = \[0.04, 0.2\]: is narrower than the rest distance"),
        ({"tap.center": [0.1, -0.05, 0.1]}, r"^tap\.center = .*: lies in floor: move the nozzle out of it"),
        ({"drain.center": [0.1, 0.3, 0.1]}, r"^drain\.center = .*: the sink covers tap"),
        ({"side.fluid": "milk"}, r"^side\.fluid = 'milk': must be one of water, oil"),
        ({"side.stop": 0.005}, r"^side.* must come after the start, 0.01 s"),
        ({"tap.direction": [0.0, 0.0, 0.0]}, r"^tap.* must not be zero"),
        ({"tap.size": [0.1, 0.1]}, r"^tap.* give either a radius, of a disc, or a size"),
        ({"far.normal": [0.0, 0.0, 0.0]}, r"^far.* must not be zero"),
        ({"side.across": [1.0, -0.5, 0.2]}, r"^side.* must not point along the direction"),
    ],
)
def test_bad_values(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(SceneError, match=told) as caught:
        tap_scene(**changes)
    assert "\n" not in str(caught.value)


def test_a_drain_lets_a_fluid_start_full() -> None:
    water = {"kind": "fluid", "size": [0.2, 0.2, 0.2], "capacity": 64}
    assert Scene({"water": water, "tap": TAP, "drain": DRAIN, "method": METHOD}).fluid_set.particle_count == 64
