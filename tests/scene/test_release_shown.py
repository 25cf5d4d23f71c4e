"""Marks of pins in pictures: gone once the pins have let go, and back in a picture of an earlier time."""

from __future__ import annotations

import numpy as np
import pytest
from release_scenes import BEAM, GRID, XPBD

from softlab.app.output.offscreen import OffscreenRenderer, opengl_available
from softlab.app.render import colours
from softlab.model.core.build import rest_positions
from softlab.model.scene.scene import Scene

WORKS, TEXT = opengl_available()
pytestmark = pytest.mark.skipif(not WORKS, reason=f"no off-screen OpenGL: {TEXT}")
BONE = {"kind": "region", "center": [0.25, 0.125, 0.125], "radius": 0.01}  # a vertex within
THICK = BEAM["beam"] | {"shape": {"name": "box", "sides": [0.5, 0.25, 0.25]}, "pinned": ["bone"]}
SCENES = {
    "grid": GRID,
    "edges": BEAM | {"method": XPBD},
    "bones": BEAM | {"beam": THICK, "bone": BONE, "method": XPBD},
    "world": BEAM | {"method": XPBD | {"solver": "world"}}
    | {"water": {"kind": "fluid", "size": [0.1, 0.1, 0.1], "rest_distance": 0.05, "origin": [0.0, -0.3, 0.0]}},
}  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
def test_pins_are_marked_while_they_hold(name: str) -> None:
    scene = Scene(SCENES[name] | {"let_go": {"kind": "release", "time": 0.5}})
    position, counts = rest_positions(scene.grid).astype(np.float32), []
    with OffscreenRenderer(scene, 320, 240, legend=False, lines=name == "edges") as renderer:
        for time in (0.0, 0.4, 0.5, 0.9, 0.1):
            renderer.draw(position, time)
            image = renderer.image()[:, :, :3] / 255
            counts.append(int((np.abs(image - colours.PIN).max(axis=2) < 0.02).sum()))
    assert counts[0] == counts[1] == counts[4] > counts[2] + 20 and counts[2] == counts[3]
