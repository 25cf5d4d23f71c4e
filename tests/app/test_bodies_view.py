"""The drawing of bodies: skins that follow clusters, particles as spheres, their window, and the hand."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bodies_scenes import BEAM, METHOD, PLANE, TORUS, beams_and_torus
from closed_meshes import rotation
from fake_cloth import FakeCloth, open_fake
from test_view3d import drawing, looks_like, near  # noqa: F401  # a fixture among them
from test_viewer import StillWindow, display, needs_display  # noqa: F401

from app.output.offscreen import OffscreenRenderer, render_frame
from app.render import colours
from app.render.bodies.skinning import ClusterFrames, of_quaternions
from app.render.camera3d import Camera3D
from app.render.collider_shapes import grounds, shadow_matrix
from app.render.particle_colours import COLOURINGS, cluster_colours, nearest_clusters, particle_colours
from app.render.scenery import KEY
from app.window.demo import Demo
from app.window.demo_report import masses_text, numbers_text
from app.window.hand import neighbour
from app.window.keys import BODY_KEYS, KEYS, hint, keys_text
from app.window.mouse import Mouse
from model.core.errors import InputError
from model.scene.scene import Scene

SCENE = beams_and_torus()
BODY_SET = SCENE.body_set
RANDOM = np.random.default_rng(6)
BENT = BODY_SET.position + 0.05 * np.sin(3 * BODY_SET.position[:, ::-1])  # m: no copy is rigid any more


def skin_of(number: int, matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(position, normal) (vertices, 3) of a copy's skin, as the shader makes them of the clusters' matrices."""
    copy = BODY_SET.copies[number]
    skin, own = copy.baked.skin, matrices[copy.first_cluster :].astype(np.float64)
    rows = np.einsum("vk,vkij->vij", skin.weights, own[skin.clusters])
    normal = np.einsum("vij,vj->vi", rows[:, :, :3], skin.normal)
    return np.einsum("vij,vj->vi", rows[:, :, :3], skin.position) + rows[:, :, 3], normal


# ---------------------------------------------------------------------- skins


def test_at_the_start_every_skin_is_its_mesh_turned_and_moved() -> None:
    matrices = ClusterFrames(SCENE).of_state(BODY_SET.position)
    placed = [(part, place) for part in SCENE.bodies.values() for place in part.places()]
    for number, (part, place) in enumerate(placed):
        skin = part.baked.skin
        position, normal = skin_of(number, matrices)
        np.testing.assert_allclose(position, skin.position @ part.turn().T + place, atol=1e-6)  # rounding of metres
        np.testing.assert_allclose(normal, skin.normal @ part.turn().T, atol=1e-6)


def test_a_bent_skin_is_that_of_the_model() -> None:
    """The clusters' rotations, then the copy's own turn, as model/assets/skin.py takes them, in float64."""
    matrices = ClusterFrames(SCENE).of_state(BENT)
    centre, turned = BODY_SET.clusters.centres(BENT), BODY_SET.clusters.rotations(BENT)
    for copy in BODY_SET.copies:
        own = slice(copy.first_cluster, copy.first_cluster + copy.baked.clusters.count)
        whole = turned[own] @ SCENE.bodies[copy.name].turn()
        position, normal = copy.baked.skin.skinned(centre[own], whole)
        drawn, outward = skin_of(copy.number, matrices)
        np.testing.assert_allclose(drawn, position, atol=2e-6)
        length = np.linalg.norm(outward, axis=1, keepdims=True)
        np.testing.assert_allclose(outward / length, normal, atol=1e-5)  # cancelled parts of means are longer than they


def test_quaternions_of_a_solver_are_its_rotations() -> None:
    turns = RANDOM.normal(0, 2, (20, 3))
    angle = np.linalg.norm(turns, axis=1, keepdims=True)
    quaternions = np.hstack([np.cos(angle / 2), np.sin(angle / 2) * turns / angle])
    np.testing.assert_allclose(of_quaternions(quaternions), [rotation(turn) for turn in turns], atol=1e-14)


class Telling(FakeCloth):
    """Bodies that tell of their clusters, by quaternions."""

    looks = 0

    def _read_clusters(self) -> tuple[np.ndarray, np.ndarray]:
        self.looks += 1
        matrices = BODY_SET.clusters.rotations(self._position)
        w = np.sqrt(1 + np.trace(matrices, axis1=1, axis2=2)) / 2  # turned by less than half a turn
        axis = np.stack([matrices[:, 2, 1] - matrices[:, 1, 2], matrices[:, 0, 2] - matrices[:, 2, 0],
                         matrices[:, 1, 0] - matrices[:, 0, 1]], axis=1)  # fmt: skip
        return np.hstack([w[:, None], axis / (4 * w[:, None])]), BODY_SET.clusters.centres(self._position)


def test_a_solver_is_asked_for_its_clusters_and_its_state_is_enough() -> None:
    frames = ClusterFrames(SCENE)
    for kind in (FakeCloth, Telling):
        simulation = kind(SCENE)
        simulation._position = BENT.copy()
        found = frames.of_simulation(simulation, BENT)
        np.testing.assert_allclose(found, frames.of_state(BENT), atol=1e-6)
        assert (
            simulation.asked == [] and getattr(simulation, "looks", 1) == 1
        )  # at the state that the caller gave, or once


# ---------------------------------------------------------------------- pictures


def renderer_of(scene: Scene, lines: bool = False) -> OffscreenRenderer:
    return OffscreenRenderer(scene, 640, 480, legend=False, lines=lines)


@pytest.mark.usefixtures("drawing")
def test_skins_have_the_colours_of_their_bodies_and_follow_the_state() -> None:
    with renderer_of(SCENE) as renderer:
        for shift in (np.zeros(3), np.array([0.0, 0.5, 0.0])):
            position = BODY_SET.position + shift
            renderer.fit(position)
            renderer.draw(position)
            image = renderer.image()
            for copy in BODY_SET.copies[:2]:
                middle = position[BODY_SET.body == copy.number].mean(axis=0)
                assert looks_like(near(image, renderer, middle), colours.BODIES[copy.number])
        hole = position[BODY_SET.body == 2].mean(axis=0)  # the torus stands: one looks through it
        assert not looks_like(near(image, renderer, hole), colours.BODIES[2])


@pytest.mark.usefixtures("drawing")
def test_the_view_of_what_falls_stays_where_it_is() -> None:
    """It holds the places below at once: what is on its way there, or lies there, changes nothing. Outermost points that are
    kept stand for all, so that the eye is the same to rounding."""
    scene = Scene({"torus": TORUS, "plane": {}, "method": METHOD})
    start = scene.body_set.position - (0.0, scene.body_set.position[:, 1].min() - 0.3, 0.0)
    with renderer_of(scene) as renderer:
        renderer.fit(start)
        eye = renderer.camera.eye
        for fallen in (0.1, 0.3):
            renderer.fit(start - (0.0, fallen, 0.0))
            np.testing.assert_allclose(renderer.camera.eye, eye, rtol=1e-9, atol=1e-9)
        renderer.fit(start - (0.0, -1.0, 0.0))
        assert np.linalg.norm(renderer.camera.eye - eye) > 0.1


@pytest.mark.usefixtures("drawing")
def test_particles_are_spheres_of_half_a_spacing() -> None:
    """The topmost particle against what is behind it: coloured up to its radius, and nothing beyond."""
    scene = Scene({"torus": TORUS | {"particle_spacing": 0.3}, "method": METHOD})
    position = scene.body_set.position
    top = position[np.argmax(position[:, 1])]
    with renderer_of(scene, lines=True) as renderer:
        renderer.camera.pitch = 0.0
        renderer.fit(position)
        renderer.draw(position)
        image = renderer.image()
        radius = np.array([0.0, 0.15, 0.0])
        assert looks_like(near(image, renderer, top + 0.9 * radius, 0), colours.BODIES[0])
        assert near(image, renderer, top + 1.15 * radius, 0).min() > 0.9
        above, below = (near(image, renderer, top + part * radius).mean() for part in (0.7, -0.2))
        assert above > 1.05 * below  # round: lit from above
        nearest = position[np.argmax(position @ renderer.camera.axes[2])]
        assert looks_like(near(image, renderer, nearest, 0), colours.BODIES[0])


@pytest.mark.usefixtures("drawing")
def test_a_nearer_sphere_hides_a_farther_one() -> None:
    """Whichever is drawn first: two tori, one behind the other, from both sides."""
    scene = Scene({"one": TORUS, "other": TORUS | {"origin": [0.0, 2.2, -0.4]}, "method": METHOD})
    position = scene.body_set.position
    with renderer_of(scene, lines=True) as renderer:
        for yaw, seen in ((0.0, 0), (np.pi, 1)):
            renderer.camera.yaw, renderer.camera.pitch = yaw, 0.0
            renderer.fit(position)
            renderer.draw(position)
            own = scene.body_set.body == seen
            places = renderer.camera.to_window(position)
            away = np.hypot(*(places[own][:, None] - places[~own]).transpose(2, 0, 1)).min(axis=1)
            place = position[own][np.argmin(away)]
            assert away.min() < 0.05 * renderer.camera.scale  # m: the other has a sphere there too
            assert looks_like(near(renderer.image(), renderer, place, 0), colours.BODIES[seen])


@pytest.mark.usefixtures("drawing")
@pytest.mark.parametrize("lines", [False, True])
def test_bodies_throw_shadows(lines: bool) -> None:
    scene = Scene({"torus": TORUS | {"angle": 0.0, "origin": [0.0, 0.5, 0.0]}, "method": METHOD} | PLANE)
    position = scene.body_set.position
    (ground,) = grounds(scene, 0.0, 0.0)
    flatten = shadow_matrix(ground, KEY)
    with renderer_of(scene, lines) as renderer:
        renderer.fit(position)
        renderer.camera.distance *= 3
        renderer.camera.pitch = 0.5
        renderer.draw(position)
        image = renderer.image()
        fallen = (np.append(position, np.ones((len(position), 1)), axis=1) @ flatten.T)[:, :3]
        away = renderer.camera.to_window(fallen)[:, None] - renderer.camera.to_window(position)
        seen = fallen[np.hypot(*away.T).min(axis=0) > 0.2 * renderer.camera.scale]  # m: beside all that is drawn
        assert len(seen) > 5
        dark = np.median([near(image, renderer, place, 0).mean() for place in seen])
        hole = near(image, renderer, (np.append(position.mean(axis=0), 1) @ flatten.T)[:3], 1)
        assert dark < 0.9 < np.median(hole.mean(axis=1)) < 0.98  # shadow, ground, and the background is white


@pytest.mark.usefixtures("drawing")
def test_one_of_particles_and_skin_is_always_shown() -> None:
    with renderer_of(SCENE) as renderer:
        view: Any = renderer._view
        pictures = []
        for change, shown in ((lambda: None, (False, True)), (view.toggle_particles, (True, True)),
                              (view.toggle_skin, (True, False)), (view.toggle_particles, (False, True)),
                              (view.toggle_skin, (True, False)), (view.toggle_lines, (False, True))):  # fmt: skip
            change()
            assert (view.particles, view.skin) == shown and view.lines == (not view.skin)
            renderer.draw(BODY_SET.position)
            pictures.append(renderer.image())
        np.testing.assert_array_equal(pictures[0], pictures[-1])
        np.testing.assert_array_equal(pictures[2], pictures[4])
        assert all((one != other).any() for one, other in ((pictures[0], pictures[1]), (pictures[1], pictures[2])))


@pytest.mark.usefixtures("drawing")
def test_bad_shapes_are_refused_and_diverged_states_drawn(tmp_path: Path) -> None:
    with renderer_of(SCENE) as renderer:
        with pytest.raises(InputError, match="this scene needs"):
            renderer.draw(BODY_SET.position[:5])
        renderer.draw(np.full_like(BODY_SET.position, np.nan))
        renderer.draw(BODY_SET.position * 1e300)
        renderer.fit(BENT)
        renderer.draw(BENT)
        renderer._view.draw(renderer.camera, 0.5, selected=3)
        ring = near(renderer.image(), renderer, BENT[3], 11)
        assert np.abs(ring - colours.SELECTED).max(axis=1).min() < 0.05
    assert render_frame(SCENE, BENT, tmp_path / "bodies.png", 160, 120).exists()


@pytest.mark.usefixtures("drawing")
def test_clusters_are_spheres_at_their_middles_seen_through_the_skin() -> None:
    with renderer_of(SCENE, lines=True) as renderer:
        view: Any = renderer._view
        renderer.fit(BENT)
        renderer.draw(BENT)
        before = renderer.image()
        view.toggle_clusters()
        renderer.draw(BENT)
        image = renderer.image()
        middles = BODY_SET.clusters.centres(BENT)
        places, depth = renderer.camera.project(middles)
        seen = [
            number
            for number in range(len(middles))
            if not ((np.hypot(*(places - places[number]).T) < 12) & (depth < depth[number])).any()
        ]
        own = cluster_colours(BODY_SET)
        matches = [looks_like(near(image, renderer, middles[number], 0), own[number]) for number in seen]
        assert np.mean(matches) > 0.8 and len(seen) > 10  # of some a particle lies before it
        assert (image != before).any()
        view.toggle_skin()
        assert view.skin and view.particles and view.clusters
        view.toggle_particles()
        renderer.draw(BENT)
        assert (renderer.image() != image).any()
        view.toggle_clusters()
        renderer.draw(BENT)
        assert (view.particles, view.skin, view.clusters) == (False, True, False)


@pytest.mark.usefixtures("drawing")
def test_links_are_lines_between_their_particles() -> None:
    scene = Scene({"beam": BEAM | {"link_radius": 0.25, "link_stiffness": 10.0, "copies": [1, 1, 1]}, "method": METHOD})
    position, links = scene.body_set.position, scene.body_set.copies[0].baked.links
    with renderer_of(scene, lines=True) as renderer:
        view: Any = renderer._view
        renderer.fit(position)
        view.toggle_links()
        renderer.draw(position)
        image, middles = renderer.image(), position[links].mean(axis=1)
        places, balls = renderer.camera.to_window(middles), renderer.camera.to_window(position)
        radius = 0.5 * BEAM["particle_spacing"] * renderer.camera.scale  # pixels, of a whole particle
        free = np.hypot(*(places[:, None] - balls).transpose(2, 0, 1)).min(axis=1) > radius + 3
        assert free.sum() > 10
        assert all(near(image, renderer, middle).max(axis=1).min() < 0.6 for middle in middles[free])
        view.toggle_links()
        renderer.draw(position)
        image = renderer.image()
        assert all(near(image, renderer, middle).max(axis=1).min() > 0.6 for middle in middles[free])
    with renderer_of(SCENE) as renderer:
        view = renderer._view
        view.toggle_links()
        assert not view.links


@pytest.mark.usefixtures("drawing")
def test_particles_are_coloured_by_body_group_and_cluster() -> None:
    scene = beams_and_torus(beam=BEAM | {"group": 5}, torus=TORUS | {"group": 5}, contact={})
    middle = int(np.flatnonzero(BODY_SET.body == 1)[0])
    with renderer_of(scene, lines=True) as renderer:
        view: Any = renderer._view
        renderer.fit(BODY_SET.position)
        nearest = int(np.argmax(np.where(BODY_SET.body == 1, BODY_SET.position @ renderer.camera.axes[2], -np.inf)))
        for colouring in (*COLOURINGS, COLOURINGS[0]):
            assert view.colouring == colouring
            renderer.draw(BODY_SET.position)
            expected = particle_colours(scene, colouring)[nearest]
            assert looks_like(near(renderer.image(), renderer, BODY_SET.position[nearest], 0), expected), colouring
            view.next_colouring()
    by_body, by_group = (particle_colours(scene, colouring) for colouring in ("body", "group"))
    assert (by_group == np.float32(colours.BODIES[0])).all()  # one group
    np.testing.assert_array_equal(by_body[middle], np.float32(colours.BODIES[1]))


def test_a_particle_has_the_colour_of_the_cluster_it_is_in_the_middle_of() -> None:
    found, clusters = nearest_clusters(BODY_SET), BODY_SET.clusters
    for particle in range(0, BODY_SET.particle_count, 7):
        entries = np.flatnonzero(clusters.indices == particle)
        away = np.linalg.norm(BODY_SET.position[particle] - clusters.rest_centre[clusters.owner[entries]], axis=1)
        assert found[particle] in clusters.owner[entries]
        assert np.linalg.norm(BODY_SET.position[particle] - clusters.rest_centre[found[particle]]) <= away.min() + 1e-12


# ---------------------------------------------------------------------- the demo


@pytest.fixture
def demo() -> Iterator[Demo]:
    with Demo([SCENE], open_world=open_fake) as running:
        yield running


def test_a_frame_takes_a_frames_time(demo: Demo) -> None:
    assert demo.steps_per_frame == 5  # of 0.005 s: 1.5 times 1/60 s, where 2 are a 1.67th of it
    demo.frame()
    assert demo.world.step == demo.steps_per_frame
    demo.change_steps(1)
    assert demo.steps_per_frame == 10


def test_the_particle_under_the_pointer_is_taken_between_others_too(demo: Demo) -> None:
    """What a skin hides between two particles that are seen 40 pixels apart."""
    viewer: Any = SimpleNamespace(demo=demo, camera=Camera3D(1200, 900), follow=True, space=True)
    viewer.pyglet = SimpleNamespace(window=SimpleNamespace(mouse=SimpleNamespace(LEFT=1, MIDDLE=2, RIGHT=4)))
    mouse = Mouse(viewer)
    torus = np.flatnonzero(BODY_SET.body == 2)
    particle = int(torus[np.argmax(BODY_SET.position[torus] @ viewer.camera.axes[2])])
    viewer.camera._aim(BODY_SET.position[particle])
    viewer.camera.distance = SCENE.bodies["torus"].particle_spacing * viewer.camera.focal / 40
    mouse.press(600 + 14.0, 450 + 14.0, 1)  # 20 pixels away, and half of what lies between the particles
    held = demo.hand.held
    assert held is not None and BODY_SET.body[held.particle] == 2 and mouse.pointer == (614.0, 464.0)
    mouse.drag(700.0, 500.0, 86.0, 36.0)
    mouse.pull()
    target = np.array(demo.hand.held.target)  # type: ignore[union-attr,arg-type]
    np.testing.assert_allclose(viewer.camera.to_window(target), (700, 500), atol=1e-6)
    assert abs((target - demo.positions[0][held.particle]) @ viewer.camera.axes[2]) < 1e-6  # in the plane of the window
    mouse.release(1)
    assert demo.hand.held is None
    mouse.press(600 + 300.0, 450.0 + 300.0, 1)  # beside it: turns the view
    assert demo.hand.held is None and mouse._moving == 1


def test_arrows_go_to_the_neighbour_that_way_in_the_same_body(demo: Demo) -> None:
    start = int(np.flatnonzero(BODY_SET.body == 1)[0])
    demo.hand.selected = start
    for direction in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0)):
        before = BODY_SET.position[demo.hand.selected]
        demo.move_selection(1, 0, direction)
        assert demo.hand.direction == direction and BODY_SET.body[demo.hand.selected] == 1
        moved = BODY_SET.position[demo.hand.selected] - before
        if moved.any():
            assert moved @ direction > 0.7 * np.linalg.norm(moved)
            others = BODY_SET.position[BODY_SET.body == 1] - before
            distance = np.linalg.norm(others, axis=1)
            better = (others @ direction > np.sqrt(0.5) * distance) & (distance < np.linalg.norm(moved) - 1e-6)
            assert not (better & (distance > 0)).any()
    assert demo.hand.selected != start
    line = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    assert neighbour(line, np.arange(3), 2, (1.0, 0.0, 0.0)) == 2


def test_the_panel_counts_particles_clusters_and_bodies(demo: Demo) -> None:
    text = numbers_text(demo, 0.02, 0.01)
    assert f"{BODY_SET.particle_count} particles in {BODY_SET.clusters.count} clusters of 3 bodies" in text
    assert "farthest from its goal" in text and "stiffness" not in text and "collider" not in text
    ball = {"kind": "sphere", "center": [9.0, 0.0, 0.0], "radius": 0.1}
    assert masses_text(beams_and_torus(**PLANE)).endswith("of 3 bodies, 1 collider")
    assert masses_text(beams_and_torus(**PLANE, ball=ball)).endswith("of 3 bodies, 2 colliders")


def test_the_keys_of_bodies_are_told() -> None:
    wide, narrow = keys_text(1200, "bodies", True), keys_text(400, "bodies", True)
    for text in (wide, narrow):
        assert all(meaning in text for _, meaning in BODY_KEYS) and "P K C I" in text
        assert all(len(meaning) < 33 and len(key) < 8 for key, meaning in BODY_KEYS)
    assert ("{ }", "stiffness / 1.25, x 1.25") in KEYS and "{ }" not in narrow
    assert "P: particles" in hint("bodies", True) and "P: " not in hint(space=True) + hint()


# ---------------------------------------------------------------------- the window


@pytest.mark.display
@needs_display
def test_window_shows_particles_and_skins_and_pulls_a_particle(tmp_path: Path, display: str) -> None:  # noqa: F811
    from PIL import Image

    window = StillWindow(tmp_path, display, beams_and_torus(gravity={"enabled": False}))
    try:
        window.wait("the first frames", lambda state: state["frame"] > 3)
        window.xdotool("mousemove", 5, 700)
        window.key("n")
        window.key("m")
        window.key("i")
        window.wait("no links", lambda state: state["message"] == "these bodies have no links" and not state["links"])
        window.wait("a graph, and no numbers", lambda state: state["graph_shown"] and not state["numbers_shown"])
        for key, name, shown in (("c", "clusters", True), ("c", "clusters", False), ("o", "colouring", "group"),
                                 ("o", "colouring", "cluster"), ("o", "colouring", "body")):  # fmt: skip
            window.key(key)
            window.wait(f"{name} {shown}", lambda state, name=name, shown=shown: state[name] == shown)
        for key, particles, skin in (("p", True, True), ("k", True, False), ("l", False, True)):
            window.key(key)
            window.wait(f"key {key}", lambda state, p=particles, k=skin: (state["particles"], state["skin"]) == (p, k))
        window.key("p")
        window.key("k")
        window.wait("particles alone", lambda state: state["particles"] and not state["skin"])
        last = BODY_SET.particle_count - 1  # of the torus
        x, y = window.grab(last)
        window.xdotool("mousemove", x, y - 40)
        state = window.wait("a pull upward", lambda state: state["poke"] is not None and state["poke"]["force"][1] > 0)
        assert state["poke"]["particle"] == last
        window.xdotool("mouseup", 1)
        window.key("s")
        state = window.wait("a screenshot", lambda state: state["screenshot"] is not None)
        picture = np.asarray(Image.open(state["screenshot"]))[:, :, :3] / 255
        torus = np.array(colours.BODIES[2])
        strong = picture[picture.sum(axis=2) > 0.3]
        alike = np.abs(strong / strong.sum(axis=1, keepdims=True) - torus / torus.sum()).max(axis=1) < 0.03
        assert alike.sum() > 500
    finally:
        window.process.kill()
        window.process.wait(timeout=10)
