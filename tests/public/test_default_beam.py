"""The beam of the lab's shapes, 1 x 0.25 x 0.25 m, weighed 90 kg in place of 62.5 in voxels of 0.1 m; `run` said nothing."""

from __future__ import annotations

import re

import numpy as np
import pytest

from softlab.app.command.run_parts import body_lines, built_report
from softlab.model.scene.scene import Scene

BEAM = {"kind": "tetrahedral_body", "shape": {"name": "beam"}}
BALL = {"kind": "tetrahedral_body", "shape": {"name": "ball", "resolution": 12}, "voxels": 5, "origin": [3.0, 0.0, 0.0]}
SOFT = {
    "kind": "soft_body",
    "shape": {"name": "ball", "resolution": 12},
    "particle_spacing": 0.2,
    "origin": [6.0, 0.0, 0.0],
}


def scene_of(solver: str = "xpbd", **more: object) -> Scene:
    return Scene(
        {"beam": BEAM | {"pinned": ["left"]}, "gravity": {}, "method": {"solver": solver, "dt": 1 / 60}} | more
    )


@pytest.mark.parametrize("solver", ["xpbd", "vbd", "newton"])
def test_the_default_beam_weighs_what_its_box_does(solver: str) -> None:
    found = scene_of(solver).tetrahedra_set
    assert found.masses.sum() == pytest.approx(62.5, rel=1e-12)
    assert np.ptp(found.position, axis=0) == pytest.approx([1.0, 0.25, 0.25], rel=1e-12)
    corners = found.position[found.tetrahedra][..., 1]
    second = (found.volume * ((corners**2).sum(axis=1) + corners.sum(axis=1) ** 2)).sum() / 20  # of y^2
    assert second == pytest.approx(0.25 * 0.25**3 / 12, rel=1e-12)


@pytest.mark.parametrize("world", [False, True])
def test_a_run_says_what_was_built(world: bool) -> None:
    method = {"method": {"solver": "world" if world else "xpbd"}}
    scene = scene_of(ball=BALL, **({"soft": SOFT} if world else {}), **method)
    lines = body_lines(scene)
    (beam,) = (line for line in lines if line.startswith("beam: ") and "voxels" in line)
    assert beam == (
        "beam: 450 tetrahedra, 176 vertices, 90 voxels of 0.1 x 0.08333 x 0.08333 m, 1 piece; 62.5 kg, volume 0.0625 m^3, "
        "that within the surface"
    )
    (ball,) = (line for line in lines if line.startswith("ball: ") and "voxels" in line)
    mesh = scene.parts["ball"].cooked.report  # type: ignore[arg-type]
    assert f"{1000 * mesh.hull_volume:.6g} kg" in ball and re.search(r"; \d+ tetrahedra are partly outside", ball)
    moments = [line for line in lines if "moments of inertia about x, y, z through the centre" in line]
    assert [line.split(":")[0] for line in moments] == [
        "beam",
        "ball",
    ] and ", 5.534, 5.534 within the surface" in moments[0]
    assert any(line.startswith("soft: ") for line in lines) == world
    built = built_report(scene)["built"]
    assert list(built) == ["beam", "ball"] and built["beam"]["mass"] == pytest.approx(62.5)
    assert built["ball"]["volume"] == pytest.approx(built["ball"]["mesh_volume"], rel=1e-12)


def test_masses_are_density_times_volume_for_every_kind_of_body() -> None:
    """Of what has a volume; a sheet weighs its area's density."""
    box = {"shape": {"name": "box", "sides": [0.5, 0.3, 0.4]}}
    for kind in ("soft_body", "rigid_body", "soft_lattice"):
        scene = Scene({"body": box | {"kind": kind, "particle_spacing": 0.11, "density": 700.0}, "gravity": {}})
        assert scene.bodies["body"].baked.mass.sum() == pytest.approx(700 * 0.06, rel=1e-12), kind
    sheet = Scene({"body": {"kind": "soft_sheet", "shape": {"name": "sheet"}, "particle_spacing": 0.1}, "gravity": {}})
    mesh = sheet.bodies["body"].baked.skin
    a, b, c = (mesh.position[corner] for corner in mesh.triangles.T)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert sheet.bodies["body"].baked.mass.sum() == pytest.approx(0.2 * area, rel=1e-12)
