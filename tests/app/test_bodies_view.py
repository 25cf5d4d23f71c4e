"""The drawing of bodies: skins that follow clusters, particles as spheres, their window, and the hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies_scenes import BEAM, METHOD, PLANE, TORUS, beams_and_torus
from real_window import StillWindow, display, needs_display  # noqa: F401
from test_view3d import drawing, looks_like, near  # noqa: F401  # a fixture among them

from softlab.app.output.offscreen import OffscreenRenderer, Picture, render_frame
from softlab.app.render import colours
from softlab.app.render.collider_shapes import grounds, shadow_matrix
from softlab.app.render.particle_colours import COLOURINGS, cluster_colours, nearest_clusters, particle_colours
from softlab.app.render.scenery import KEY
from softlab.model.base.errors import InputError
from softlab.model.scene.scene import Scene

SCENE = beams_and_torus()
BODY_SET = SCENE.body_set
BENT = BODY_SET.position + 0.05 * np.sin(3 * BODY_SET.position[:, ::-1])  # m: no copy is rigid any more


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
    assert render_frame(SCENE, BENT, tmp_path / "bodies.png", Picture(160, 120)).exists()


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
