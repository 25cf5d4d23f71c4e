"""The model `isometric` of bending knows no sign of an angle: meshes bent at rest are refused, and `dihedral` holds them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene


def hinge(degrees: float) -> np.ndarray:
    """(4, 3) [m]: two right triangles at an edge along z, one of which is turned about it."""
    angle = np.radians(degrees)
    return np.array([[0, 0, 0], [0, 0, 0.1], [0.1, 0, 0], [-0.1 * np.cos(angle), 0.1 * np.sin(angle), 0.1]])


def hinge_scene(folder: Path, degrees: float, model: str, **parts: Any) -> Scene:
    """Of a hinge that is bent at rest."""
    file = folder / "hinge.obj"
    text = [f"v {x!r} {y!r} {z!r}" for x, y, z in hinge(degrees).tolist()] + ["f 1 2 3", "f 2 1 4"]
    file.write_text("\n".join(text) + "\n")
    method = {"solver": "xpbd", "dt": 0.01, "substeps": 4}
    tables = {
        "mesh": {"file": str(file), "density": 0.3}, "structural": {"stiffness": 1e3},
        "crease": {"kind": "bending", "model": model, "stiffness": 0.01}, "damping": {"coefficient": 0.01}, "method": method,
    }  # fmt: skip
    return Scene(tables | parts)


BOX = {
    "kind": "tetrahedral_body",
    "shape": {"name": "box", "sides": [0.1, 0.1, 0.1]},
    "edge": 0.1,
    "origin": [0, 1.0, 0],
}


@pytest.mark.parametrize("degrees", [90.0, -150.0, 5.0])
@pytest.mark.parametrize("beside", [{}, {"box": BOX}])
def test_a_mesh_that_is_bent_at_rest_is_refused(tmp_path: Path, degrees: float, beside: dict[str, Any]) -> None:
    """Alone and beside tetrahedra, by the name that the scene gives its bending, with the angle and what to do."""
    scene = hinge_scene(tmp_path, degrees, "isometric", **beside)
    words = (
        rf"crease\.model = 'isometric'.*bent by {abs(degrees):.3g} degrees.*"
        r'scene\.replace\(\{"crease\.model": "dihedral"\}\)'
    )
    with pytest.raises(SceneError, match=words):
        open_simulation(scene, "cpu", math="exact", threads=1)


def test_what_a_file_leaves_of_flatness_is_not(tmp_path: Path) -> None:
    """Half a degree."""
    scene = hinge_scene(tmp_path, 0.5, "isometric")
    with open_simulation(scene, "cpu", math="exact", threads=1) as simulation:
        simulation.advance(1)


def test_dihedral_returns_from_flat(tmp_path: Path) -> None:
    """The remedy: laid flat and let go, a hinge of 90 degrees comes back to them, damped over 3 s, within a degree."""
    scene = hinge_scene(tmp_path, 90.0, "dihedral")
    body = build(scene)
    flat = hinge(0.0)
    start = State(flat, np.zeros_like(flat), body.inverse_mass, 0.0, 0)
    with open_simulation(scene, "cpu", initial=start, precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(100)
        a, b, c, d = simulation.state().position
    n, m = np.cross(b - a, c - a), np.cross(d - a, b - a)
    angle = np.degrees(np.arccos(n @ m / np.linalg.norm(n) / np.linalg.norm(m)))
    assert angle == pytest.approx(90.0, abs=1.0)
