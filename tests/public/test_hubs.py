"""A mesh with a vertex of over 1024 edges, as the cap of a finely divided cylinder, was refused, and so was what the message
advised. It works now; of far more edges the advice does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.geometry import colouring
from softlab.model.geometry.colouring import MAX_COLOURS, RINGS
from softlab.model.scene.scene import Scene
from softlab.model.scene.sheets import mesh_lines

DROP = 0.5 * 9.81 * 0.01**2  # m: a free fall of the ten steps below, semi-implicit: a bit more


def disc(path: Path, outer: int, inner: int = 0) -> Path:
    """Triangles around a vertex at the middle, to a ring of `inner` vertices, where it is given, and on to one of `outer`."""
    angle = np.concatenate([np.arange(inner) * 2 * np.pi / max(inner, 1), np.arange(outer) * 2 * np.pi / outer])
    radius = np.repeat([0.5, 1.0], [inner, outer])
    x, z = radius * np.cos(angle), radius * np.sin(angle)
    lines = ["v 0 0 0", *(f"v {px:.9g} 0 {pz:.9g}" for px, pz in zip(x, z, strict=True))]
    ring = inner or outer
    lines += [f"f 1 {2 + (k + 1) % ring} {2 + k}" for k in range(ring)]
    for k in range(
        outer if inner else 0
    ):  # an outer edge to the inner vertex behind it; where that changes, an inner edge
        own, following = k * inner // outer, (k + 1) * inner // outer
        lines.append(f"f {2 + own} {2 + inner + (k + 1) % outer} {2 + inner + k}")
        if following > own:
            lines.append(f"f {2 + own} {2 + following % inner} {2 + inner + (k + 1) % outer}")
    path.write_text("\n".join(lines) + "\n")
    return path


def scene_of(path: Path) -> Scene:
    return Scene(
        {
            "mesh": {"file": str(path), "density": 0.2},
            "structural": {"stiffness": 500.0},
            "gravity": {},
            "method": {"solver": "xpbd", "dt": 0.001, "substeps": 2},
        }
    )


def fall(scene: Scene) -> np.ndarray:
    """Where its vertices are after ten steps."""
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(10)
        return np.asarray(simulation.state().position)


def test_a_disc_around_one_vertex_falls_as_one(tmp_path: Path) -> None:
    scene = scene_of(disc(tmp_path / "fan.obj", 1500))
    position = fall(scene)
    assert len(position) == 1501 and np.ptp(position[:, 1]) < 1e-9
    assert -position[0, 1] == pytest.approx(DROP, rel=0.1)
    (note,) = (line for line in mesh_lines(scene) if "edges meet" in line)
    assert note.startswith("fan.obj: 1500 edges meet at vertex 0 (counted from 0, at (0, 0, 0))") and RINGS in note


def test_what_the_message_advises_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(colouring, "MAX_COLOURS", 64)
    with pytest.raises(
        SceneError, match=r"constraints = 100: meet at vertex 0 .counted from 0., and at most 64 can"
    ) as error:
        fall(scene_of(disc(tmp_path / "fan.obj", 100)))
    assert RINGS in str(error.value)
    position = fall(scene_of(disc(tmp_path / "rings.obj", 100, 10)))
    assert len(position) == 111 and np.ptp(position[:, 1]) < 1e-9


def test_no_note_where_few_edges_meet(tmp_path: Path) -> None:
    assert not [line for line in mesh_lines(scene_of(disc(tmp_path / "rings.obj", 100, 10))) if "edges meet" in line]


def test_beyond_the_limit_the_message_names_it(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=f"at most {MAX_COLOURS} can; .*rings"):
        open_simulation(scene_of(disc(tmp_path / "fan.obj", MAX_COLOURS + 1)))
