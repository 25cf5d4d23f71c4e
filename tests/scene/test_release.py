"""Pins that let go at a time: what falls then, what a restart and a state do to them, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from release_scenes import BEAM, GRID, LETS_GO, MORE, TABLES, XPBD, G, end_state, release_scene

from softlab.app.driver import open_simulation
from softlab.app.output.files import read_state, write_state
from softlab.app.shared import check_cut
from softlab.bench.experiments.accuracy.judge import judge_run
from softlab.bench.reference import mass_spring, xpbd_mesh
from softlab.model.base.errors import InputError, SceneError, UnstableTimeStep
from softlab.model.core.build import build, masses
from softlab.model.core.families import stability_limit
from softlab.model.scene.scene import Scene, load_scene

FILE: dict[str, Any] = {
    "mesh": {"file": "garment.obj", "density": 0.2, "pinned": [0, 1, 2]}, "structural": {}, "method": {"solver": "xpbd"},
}  # fmt: skip
FALLS = [name for name in TABLES if name != "implicit"]  # to which a substep's fall is that of semi-implicit Euler


def solids(scene: Scene, position: np.ndarray) -> np.ndarray:
    return position[scene.world_set.slices()["tetrahedra"]] if scene.is_world else position


@pytest.mark.parametrize("name", FALLS)
def test_what_is_let_go_of_falls_freely(name: str) -> None:
    """y = -g h^2 n(n+1)/2 in n substeps of h, once every mass that rested is free; before, nothing moves. Rounding is of
    positions to 4 m over n substeps: 1e-14 m."""
    scene = release_scene(name, all_pinned=True)
    start, before, after = (end_state(scene, "cpu", steps) for steps in (0, LETS_GO, LETS_GO + MORE))
    assert np.array_equal(solids(scene, before.position), solids(scene, start.position))
    assert (solids(scene, start.inverse_mass) == 0).all() and (before.inverse_mass > 0).all()
    n, h = MORE * scene.method.substeps, scene.method.dt / scene.method.substeps
    fallen = solids(scene, after.position) - solids(scene, start.position)
    np.testing.assert_allclose(fallen[:, 1], -G * h**2 * n * (n + 1) / 2, atol=1e-14)
    fallen[:, 1] = 0
    assert np.abs(fallen).max() < 1e-14


@pytest.mark.parametrize("name", TABLES)
def test_it_goes_on_as_the_scene_without_these_pins(name: str) -> None:
    """To the bit; also from a state of either side, and from the start again, where the pins hold as before."""
    scene = release_scene(name)
    without = Scene(scene.at(1.0).as_dict())
    with open_simulation(scene, math="exact", precision="float64") as simulation:
        start, pinned = simulation.state(), simulation.body.pinned
        simulation.advance(LETS_GO - 1)
        early = simulation.state()
        held = early.position[pinned]
        assert len(pinned) and np.array_equal(held, start.position[pinned])
        simulation.advance(1 + MORE)
        end = simulation.state()
        for again in (early, start, None):
            if again is None:
                simulation.reset()
            else:
                simulation.load(again)
            assert np.array_equal(simulation.body.pinned, pinned)
            simulation.advance(LETS_GO + MORE - simulation.step)
            assert np.array_equal(simulation.state().position, end.position)
    at_release = end_state(scene, "cpu", LETS_GO)
    by_hand = end_state(without, "cpu", MORE, at_release)
    assert np.array_equal(by_hand.position, end.position) and np.array_equal(by_hand.velocity, end.velocity)
    assert np.abs(end.position[pinned] - held).max() > G * (MORE * scene.method.dt) ** 2 / 8


@pytest.mark.parametrize("name", ["grid", "cloth", "mesh"])
def test_the_states_are_the_references(name: str) -> None:
    """NumPy's, of the pinned scene up to the step and of the free one after it: rounding alone."""
    scene = release_scene(name)
    body, free = build(scene), Scene(scene.at(1.0).as_dict())
    state = end_state(scene, "cpu")
    position, velocity = body.position, body.velocity
    for one, steps, first in ((scene, LETS_GO, 0), (free, MORE, LETS_GO)):
        if scene.mesh:
            weights = np.broadcast_to(masses(scene), (len(position), 1))[:, 0]
            own = one if one is free else Scene({k: v for k, v in one.as_dict().items() if k != "let_go"})
            position, velocity = xpbd_mesh.simulate(own, steps, position, velocity, weights, first)
        else:
            position, velocity = mass_spring.simulate(one, steps, position, velocity, first)
    np.testing.assert_allclose(state.position, position, atol=1e-13)
    np.testing.assert_allclose(state.velocity, velocity, atol=1e-11)


def test_a_state_file_has_the_pins_of_its_time(tmp_path: Path) -> None:
    scene = release_scene("grid")
    end = end_state(scene, "cpu")
    for steps in (1, LETS_GO, LETS_GO + 1):
        file = write_state(tmp_path / f"{steps}.npz", end_state(scene, "cpu", steps))
        state = read_state(file, scene)
        assert np.array_equal(end_state(scene, "cpu", LETS_GO + MORE - steps, state).position, end.position)
    early = end_state(scene, "cpu", 1)
    with open_simulation(scene, precision="float64") as simulation:
        simulation.advance(LETS_GO)
        with pytest.raises(InputError, match="inverse_mass differs"):
            simulation.load(early.__class__(early.position, early.velocity, early.inverse_mass, 1.0, 128))
        assert not len(simulation.body.pinned) and simulation.step == LETS_GO  # as it was


def test_some_let_go_and_others_later() -> None:
    """A motion ends with its pins, whose speed they keep; the motion of the others goes on."""
    dt = TABLES["cloth"]["method"]["dt"]
    turn = {"kind": "motion", "velocity": [0.0, 0.5, 0.0], "duration": 9.0}
    scene = Scene(
        TABLES["cloth"]
        | {"up": turn | {"pins": "left"}, "way": turn | {"pins": "right"}}
        | {"first": {"kind": "release", "pins": [[0, 0], [1, 0]], "time": 2 * dt}}
        | {"last": {"kind": "release", "time": 4 * dt}}
    )
    counts, speeds = [], []
    with open_simulation(scene, precision="float64") as simulation:
        for _ in range(6):
            counts.append(len(simulation.body.pinned))
            speeds.append(simulation.read("velocity")[0, 1])
            simulation.advance(1)
    assert counts == [6, 6, 4, 4, 0, 0]
    assert speeds[:3] == [0.5, 0.5, 0.5] and speeds[3] == pytest.approx(0.5 - G * dt, rel=1e-3)
    assert [sorted(one.motions) for _, one in scene.phases] == [["up", "way"], []]


def test_live_changes_and_the_poke_outlast_a_release() -> None:
    scene = release_scene("grid", all_pinned=True)
    with open_simulation(scene, precision="float64", live=("gravity", "poke")) as simulation:
        simulation.set("gravity.acceleration", 2.0)
        simulation.poke(0, (0.5, 0.0))
        simulation.warm_up()
        assert simulation.step == 0 and len(simulation.body.pinned) == 12
        simulation.advance(LETS_GO + 1)
        dt, velocity = scene.method.dt, simulation.read("velocity")
        np.testing.assert_allclose(velocity[5], (0.0, -2.0 * dt), atol=1e-15)
        assert velocity[0, 0] == pytest.approx(0.5 * dt / scene.grid.mass)
        simulation.set("gravity.acceleration", 4.0)
        simulation.advance(1)
        assert simulation.read("velocity")[5, 1] == pytest.approx(-6.0 * dt, rel=1e-3)
        simulation.reset()
        assert len(simulation.body.pinned) == 12 and simulation.scene.gravity.acceleration == 4.0


def test_a_closed_simulation_stays_closed() -> None:
    with open_simulation(release_scene("grid"), precision="float64") as simulation:
        simulation.advance(LETS_GO)
    with pytest.raises(InputError, match="this simulation is closed"):
        simulation.reset()
    assert simulation.closed


def test_vertices_of_a_file_let_go_by_their_numbers() -> None:
    scene = Scene(FILE | {"release": {"time": 1.0, "pins": [1]}, "rest": {"kind": "release", "time": 2.0}})
    assert [scene.at(time).mesh.pinned for time in (0.0, 1.0, 2.0)] == [[0, 1, 2], [0, 2], "none"]  # type: ignore[union-attr]


def test_an_attachment_lets_go() -> None:
    """Of what is glued to the world: its other pins stay."""
    glue = {"kind": "attachment", "body": "beam", "vertices": "right"}
    scene = Scene(BEAM | {"method": XPBD, "glue": glue, "let_go": {"kind": "release", "pins": "glue", "time": 0.01}})
    assert [len(build(one).pinned) for one in (scene, scene.at(0.02))] == [8, 4]
    assert not scene.at(0.02).attachment_parts and scene.at(0.02).at(0.0) is scene


def test_the_step_size_must_hold_without_the_pins() -> None:
    """A light mass has a damper that no long step holds; while it is pinned, that does not count."""
    light = {"kind": "load", "at": [0, 0], "mass": 1e-4}
    scene = Scene(GRID | {"light": light, "damping": {"coefficient": 0.1}, "method": XPBD})
    free = Scene(scene.as_dict() | {"grid": GRID["grid"] | {"pinned": "none"}})
    assert stability_limit(free) < scene.method.dt < stability_limit(scene)
    loose = Scene(scene.as_dict() | {"release": {"time": 1.0}})
    assert stability_limit(loose) == stability_limit(free)
    with pytest.raises(UnstableTimeStep):
        open_simulation(loose)


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        (GRID | {"release": {"time": 0.0}}, "release.time = 0.0: must be greater than 0"),
        (GRID | {"release": {}}, "release.time: must be given (s)"),
        (GRID | {"release": {"time": 1.0, "pins": "bottom"}}, "release.pins = 'bottom': names no pin of grid"),
        (GRID | {"release": {"time": 1.0, "pins": [[0, 9]]}}, "release.pins = [0, 9]: lies outside the sheet"),
        (GRID | {"release": {"time": 1.0, "body": "gird"}}, "must be one of grid (did you mean grid?)"),
        (
            GRID | {"release": {"time": 1.0, "pins": "every:0"}},
            "release.pins = 'every:0': must be one of none, top, bottom",
        ),
        (GRID | {"release": {"time": 1.0, "pins": [3]}}, "release.pins = [3]: names no pin of grid"),
        (FILE | {"release": {"time": 1.0, "pins": "left"}}, "release.pins = 'left': names no pin of mesh"),
        (FILE | {"release": {"time": 1.0, "pins": [[0, 0]]}}, "names no pin of mesh"),
        (GRID | {"release": {"time": 1.0, "pins": []}}, "release.pins = []: must name pins: all"),
        (BEAM | {"release": {"time": 1.0, "pins": "right"}}, "release.pins = 'right': names no pin of beam"),
        (
            BEAM
            | {"beam": BEAM["beam"] | {"pinned": ["left", "half"]}, "half": {"kind": "region", "low": [-9, -9, -9]}}
            | {"motion": {"pins": "right", "velocity": [1.0, 0.0, 0.0]}, "release": {"time": 1.0, "pins": "half"}},
            "release.pins = 'half': leaves a scene that cannot be simulated: motion.pins = 'right': 4 of these 4",
        ),
        (load_scene("jelly-drop").as_dict() | {"release": {"time": 1.0}}, "needs pins, which a grid, a cloth, a mesh"),
        (load_scene("dam-break").as_dict() | {"release": {"time": 1.0}}, "needs pins, which a grid, a cloth, a mesh"),
    ],
)
def test_what_cannot_be_is_refused(tables: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError) as caught, open_simulation(Scene(tables)):
        pass
    assert said in str(caught.value)


def test_sharing_live_targets_and_an_error_are_refused() -> None:
    scene = release_scene("sheet")
    with pytest.raises(SceneError, match="releases pins, which is not supported on several GPUs"):
        check_cut(scene, 2, None, None, "--gpus")
    with pytest.raises(SceneError, match="live = 'targets': moves pins, which let_go releases"):
        open_simulation(release_scene("rows"), live=["targets"])
    error, reason = judge_run(scene, end_state(scene, "cpu"), None)
    assert error is None and "supports released pins" in str(reason)


def test_the_window_keeps_released_pins_free_until_a_restart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where a field is changed that opens the scene again; a scene that is saved has all its pins and the release."""
    from softlab.app.window.demo import Demo
    from softlab.app.window.snapshot import save_scene

    monkeypatch.chdir(tmp_path)
    with Demo([release_scene("sheet")]) as demo:
        demo.set_steps(5)
        demo.frame()
        assert demo.world.step == 5 and not len(demo.world.body.pinned)
        assert demo.set_field("method.iterations", 3) and "state kept" in demo.message
        assert demo.world.step == 5 and not len(demo.world.body.pinned)
        assert load_scene(tmp_path / save_scene(demo, "kept.toml")).phases[0][0] == release_scene("sheet").phases[0][0]
        demo.restart()
        assert demo.world.step == 0 and len(demo.world.body.pinned) == 6
