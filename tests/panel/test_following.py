"""The window's camera follows what is to be seen, without a window: a viewer with a camera and numbers in its place."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.app.render.views import camera_of
from softlab.app.window.following import Following
from softlab.model.core.build import build
from softlab.model.scene.scene import Scene, load_scene


def viewer_of(scene: Scene) -> Any:
    world = SimpleNamespace(scene=scene, body=build(scene), time=0.0)
    demo = SimpleNamespace(worlds=[world], world=world, statistics=SimpleNamespace(bounds=None))
    view = SimpleNamespace(lower_ground=lambda height: None)
    return SimpleNamespace(
        demo=demo, camera=camera_of(scene, 800, 600), space=scene.dimensions == 3, panes=[None], views=[view]
    )


def bounds_of(viewer: Any, up: float) -> tuple[float, ...]:
    position = viewer.demo.world.body.position
    low, high = position.min(axis=0), position.max(axis=0)
    high[1] += up
    return (*low.tolist(), *high.tolist())


def distances(scene: Scene) -> list[float]:
    """Of the camera, before a splash, while drops fly, once they have landed, and after F."""
    viewer = viewer_of(scene)
    following, found = Following(viewer), []
    for up, share in ((0.0, 1.0), (1.0, 0.9), (0.0, 0.9), (0.0, 1.0)):
        viewer.demo.statistics.bounds = bounds_of(viewer, up)
        for _ in range(40):
            following.approach(share)
        found.append(viewer.camera.distance)
    return found


def test_a_tank_keeps_its_size_while_drops_fly_and_land() -> None:
    before, flying, landed, framed = distances(load_scene("dam-break"))
    assert before < flying == landed and np.isclose(framed, before)


def test_a_body_is_followed_both_ways() -> None:
    before, up, down, _ = distances(load_scene("jelly-block"))
    assert before < up and np.isclose(down, before, rtol=1e-3)


def test_the_scenes_camera_comes_before_what_is_to_be_seen() -> None:
    scene = load_scene("dam-break").replace({"camera.size": 2.0, "camera.target": [0.5, 0.25, 0.0]})
    before, flying, landed, framed = distances(scene)
    assert np.allclose([flying, landed, framed], before)
