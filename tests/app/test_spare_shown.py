"""Bodies that wait, in the demo, in pictures and in files: nothing of them is there, and a key brings them in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from bodies_scenes import BEAM, METHOD, TORUS, beams_and_torus
from fake_cloth import FakeCloth, open_fake
from real_window import StillWindow, display, needs_display  # noqa: F401
from test_view3d import drawing, looks_like, near  # noqa: F401  # a fixture among them

from softlab.app.families.bodies import bodies_report
from softlab.app.output.export import Exporter, check_export
from softlab.app.output.offscreen import OffscreenRenderer, Picture, render_frame
from softlab.app.output.pieces import pieces_of
from softlab.app.render import colours
from softlab.app.render.bodies.skinning import ClusterFrames
from softlab.app.render.camera3d import Camera3D
from softlab.app.window.demo import Demo
from softlab.app.window.demo_report import demo_state, masses_text
from softlab.app.window.mouse import Mouse
from softlab.model.core.energy import energies
from softlab.model.core.spare import Counts, counts, inactive, present
from softlab.model.scene.scene import Scene, load_scene

SPARE = beams_and_torus(torus=TORUS | {"spare": 2})
ALONE = beams_and_torus()
BODY_SET, COUNT = SPARE.body_set, ALONE.body_set.particle_count
HERE = (4.0, 3.0, 0.5)  # m, where nothing else is
LINKED = BEAM | {"link_radius": 0.25, "link_stiffness": 10.0}


def with_a_torus() -> FakeCloth:
    simulation = FakeCloth(SPARE)
    assert simulation.add_body("torus", HERE) == 3
    return simulation


def test_what_waits_has_no_energy_and_is_in_no_count() -> None:
    state, alone = FakeCloth(SPARE).state(), FakeCloth(ALONE).state()
    found = energies(SPARE, state.position, state.velocity)
    assert found == energies(SPARE, state.position, state.velocity, inverse_mass=state.inverse_mass)
    known = energies(ALONE, alone.position, alone.velocity)
    assert (
        found["gravity"] == pytest.approx(known["gravity"], rel=1e-14) and known["gravity"] > 0
    )  # sums of other lengths
    simulation = with_a_torus()
    one = simulation.scene.bodies["torus"]
    raised = simulation.energies()["gravity"] - found["gravity"]
    torus = BODY_SET.copies[3].particles
    height = (BODY_SET.clusters.mass[torus] @ simulation.state().position[torus, 1]) / BODY_SET.clusters.mass[
        torus
    ].sum()
    assert raised == pytest.approx(9.81 * BODY_SET.clusters.mass[torus].sum() * height) and one.spare == 2
    weights = simulation.body.inverse_mass
    assert masses_text(SPARE) == f"{masses_text(ALONE)} + 2 inactive" and masses_text(ALONE).endswith("of 3 bodies")
    ring = ALONE.bodies["torus"].baked
    more = f"{COUNT + len(ring.position)} particles in {ALONE.body_set.clusters.count + ring.clusters.count} clusters"
    assert masses_text(SPARE, weights) == f"{more} of 4 bodies + 1 inactive"
    report = bodies_report(simulation)
    assert (report["bodies"], report["waiting"], report["waiting_particles"]) == (4, 1, len(ring.position))
    assert counts(SPARE) == replace(counts(ALONE), waiting=2, waiting_particles=2 * len(ring.position))
    assert (
        counts(ALONE) == Counts(COUNT, ALONE.body_set.clusters.count, 3) and counts(load_scene("lab-grid")).waiting == 0
    )
    assert inactive(ALONE) is None and inactive(ALONE, np.zeros(COUNT)) is not None
    assert len(present(SPARE, state.position)) == COUNT
    assert present(ALONE, alone.position, np.zeros(COUNT)) is alone.position  # none would be left


def image_of(scene: Scene, show: Any, position: np.ndarray, inverse_mass: np.ndarray | None = None) -> np.ndarray:
    with OffscreenRenderer(scene, 480, 360, legend=False) as renderer:
        show(renderer._view)
        renderer.show_bodies(inverse_mass)
        renderer.fit(position)
        renderer.draw(position)
        return renderer.image()


@pytest.mark.usefixtures("drawing")
@pytest.mark.parametrize("way", ["toggle_particles", "toggle_lines", "toggle_clusters", "toggle_links", "draw"])
def test_a_picture_is_that_of_a_scene_without_what_waits(way: str) -> None:
    """To the pixel, also where it waits far away from the others; and another one when it has come."""

    def show(view: Any) -> None:
        if way != "draw":
            getattr(view, way)()

    scenes = [
        Scene({"torus": TORUS, "beam": LINKED | {"spare": spare}, "gravity": {}, "method": METHOD}) for spare in (0, 2)
    ]
    alone, spare = scenes
    position = spare.body_set.position.copy()
    position[alone.body_set.particle_count :] += (50.0, 0.0, 0.0)
    without = image_of(alone, show, alone.body_set.position)
    assert np.array_equal(image_of(spare, show, position), without)
    assert without.std() > 1 and (way != "toggle_links" or len(spare.body_set.copies[1].baked.links))
    all_there = 1 / spare.body_set.clusters.mass
    assert not np.array_equal(image_of(spare, show, spare.body_set.position + 0.0, all_there), without) or way == "draw"


@pytest.mark.usefixtures("drawing")
def test_what_comes_in_is_drawn_and_what_leaves_is_gone(tmp_path: Path) -> None:
    simulation = with_a_torus()
    position = simulation.state().position
    place = position[BODY_SET.copies[3].particles]
    middle, rim = place.mean(axis=0), place[np.argmax(place[:, 1])]
    with OffscreenRenderer(SPARE, 640, 480, legend=False) as renderer:
        view: Any = renderer._view
        for number in (3, None):
            if number is None:
                simulation.remove_body(3)
            renderer.show_bodies(simulation.body.inverse_mass)
            renderer.fit(position)
            view.upload_from(simulation)
            view.draw(renderer.camera, 0.5)
            seen = looks_like(
                near(renderer.image(), renderer, (middle + rim) / 2 + (rim - middle) / 2.2), colours.BODIES[3]
            )
            assert seen == (number is not None)
        view.delete()
    path = render_frame(
        SPARE, position, tmp_path / "a.png", Picture(64, 64, legend=False), inverse_mass=1 / BODY_SET.clusters.mass
    )
    assert path.exists()


def test_what_waits_is_not_exported(tmp_path: Path) -> None:
    simulation = with_a_torus()
    position = simulation.state().position.astype(np.float64)
    matrices = ClusterFrames(SPARE).of_state(position)
    assert [piece.name for piece in pieces_of(SPARE, position, matrices)] == ["beam-1", "beam-2", "torus-1"]
    weights = simulation.body.inverse_mass
    names = [piece.name for piece in pieces_of(SPARE, position, matrices, weights)]
    assert names == ["beam-1", "beam-2", "torus-1", "torus-2"]
    target = check_export(str(tmp_path / "end.ply"), None, 0.01, [])
    Exporter(simulation, target).finish(simulation, [])
    mesh = trimesh.load(tmp_path / "end.ply", process=False)
    assert len(mesh.vertices) == sum(len(copy.baked.skin.position) for copy in BODY_SET.copies[:4])


# ---------------------------------------------------------------------- the demo


@pytest.fixture
def demo() -> Iterator[Demo]:
    with Demo([SPARE], open_world=open_fake) as running:
        yield running


def test_a_key_drops_the_next_body_above_everything_and_another_takes_it_out(demo: Demo) -> None:
    before = demo.statistics
    demo.drop_body((0.0, 2.5, 1.0))
    assert demo.message == "torus dropped: 4 bodies, 1 inactive"
    torus = demo.position[BODY_SET.copies[3].particles]
    low, high = torus.min(axis=0), torus.max(axis=0)
    np.testing.assert_allclose((low + high)[[0, 2]] / 2, (0.0, 1.0), atol=1e-6)
    assert low[1] == pytest.approx(2.5 + 0.1 * (high - low).max(), abs=1e-5)
    assert demo.statistics.energy > before.energy and demo.statistics.bounds[4] == pytest.approx(high[1], abs=1e-5)
    demo.drop_body((0.0, 9.0, 0.0))
    demo.drop_body((0.0, 19.0, 0.0))
    assert "torus.spare = 2" in demo.message and "press X" in demo.message
    demo.remove_body()
    assert demo.message.startswith("select a body first")
    demo.take(BODY_SET.copies[3].first_particle, (0.0, 0.0, 0.0))
    demo.remove_body()
    assert demo.message == "torus removed: 4 bodies, 1 inactive"
    assert demo.picker.selected is None and demo.picker.poke is None
    demo.frame()
    demo.restart()
    assert (demo.world.body.inverse_mass == 0).sum() == BODY_SET.waiting.sum()
    camera = Camera3D(1200, 900)
    pane: Any = SimpleNamespace(left=0, bottom=0)
    assert demo_state(demo, camera, pane, 900)["waiting"] == 2


def test_parts_take_turns() -> None:
    scene = beams_and_torus(torus=TORUS | {"spare": 1}, beam=BEAM | {"spare": 2})
    with Demo([scene], open_world=open_fake) as demo:
        dropped = []
        for height in (5.0, 10.0, 15.0):
            demo.drop_body((0.0, height, 0.0))
            dropped.append(demo.message.split()[0])
        assert dropped == ["beam", "torus", "beam"]


def test_without_spare_bodies_a_message_says_what_to_add() -> None:
    with Demo([ALONE], open_world=open_fake) as demo:
        demo.drop_body((0.0, 5.0, 0.0))
        assert "set spare = 5 in [beam]" in demo.message
        demo.take(0, (0.0, 0.0, 0.0))
        demo.remove_body()
        assert "beam.spare" in demo.message and demo.picker.selected == 0


def test_what_waits_is_neither_picked_nor_selected(demo: Demo) -> None:
    """The last two toruses lie in the first, whose particles the pointer finds; alone they are not found."""
    viewer: Any = SimpleNamespace(demo=demo, camera=Camera3D(1200, 900), follow=True, space=True)
    viewer.pyglet = SimpleNamespace(window=SimpleNamespace(mouse=SimpleNamespace(LEFT=1, MIDDLE=2, RIGHT=4)))
    mouse = Mouse(viewer)
    viewer.camera._aim(BODY_SET.position[BODY_SET.copies[3].first_particle])
    viewer.camera.distance = 10.0
    mouse.press(600.0, 450.0, 1)
    assert demo.picker.poke is not None and BODY_SET.body[demo.picker.poke.particle] == 2
    mouse.release(1)
    demo.remove_body()
    assert demo.message.startswith("torus removed")
    mouse.press(600.0, 450.0, 1)
    assert demo.picker.poke is None
    mouse.release(1)
    demo.move_selection(0, 0)
    assert demo.picker.selected is not None and BODY_SET.body[demo.picker.selected] < 2  # the middle one of those there
    for copy in (0, 1):
        demo.picker.selected = BODY_SET.copies[copy].first_particle
        demo.remove_body()
    demo.move_selection(0, 0)
    assert demo.message == "no active body to select" and demo.picker.selected is None
    demo.frame()
    assert not demo.frozen


@pytest.mark.display
@needs_display
def test_keys_of_the_window_drop_over_the_pointer_and_take_out(tmp_path: Path, display: str) -> None:  # noqa: F811
    with StillWindow(
        tmp_path, display, beams_and_torus(gravity={"enabled": False}, torus=TORUS | {"spare": 2})
    ) as window:
        window.wait("bodies to come", lambda state: state["waiting"] == 2)
        window.xdotool("mousemove", 300, 400)
        window.key("d")
        state = window.wait("a body", lambda state: state["waiting"] == 1)
        assert state["message"] == "torus dropped: 4 bodies, 1 inactive"
        left, high = state["low"][0], state["high"][1]
        window.xdotool("mousemove", 900, 400)
        window.key("d")
        state = window.wait("another one", lambda state: state["waiting"] == 0)
        assert state["high"][1] > high and state["high"][0] > left + 1  # the other one, higher
        window.key("d")
        window.wait("none is left", lambda state: "press X" in state["message"])
        window.grab(0)
        window.xdotool("mouseup", 1)
        window.key("x")
        state = window.wait("a body less", lambda state: state["waiting"] == 1)
        assert state["message"] == "beam removed: 4 bodies, 1 inactive" and state["selected"] is None
        window.key("r")
        window.wait("as at the start", lambda state: state["waiting"] == 2)
