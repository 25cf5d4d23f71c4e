"""Links of bodies and sheets made of them: against the reference, the law of one link, what a mesh gives, bad input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies_scenes import (
    BAR,
    LIVE,
    bodies_scene,
    by_hand,
    clusters_of,
    end_state,
    hung,
    method,
    opened,
    same,
    start,
)

from softlab.model.assets.soft_sheet import SoftSheet
from softlab.model.base.errors import InputError
from softlab.model.geometry.shapes import Shape
from softlab.model.particles.links import LinkedCopies, make_links
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.plan import body_plan

SHEET: dict[str, Any] = {"kind": "soft_sheet", "shape": {"name": "sheet", "resolution": 6}, "particle_spacing": 1 / 6}


def test_one_link_is_an_implicit_euler_step_of_its_spring() -> None:
    """Two masses m on a spring k, stretched by s along x: s' = (s + h u) / (1 + 2 k h^2 / m), u' = (s' - s) / h (Macklin et
    al. 2016, eq. 18, with one iteration). 40 steps of some 10 roundings of 1.2 m."""
    k, m, h, length = 70.0, 0.5, 0.01, 1.0
    clusters = clusters_of([[0.0, 0.0, 0.0], [length, 0.0, 0.0]], [[0]], mass=[m, m])
    link = LinkedCopies(np.array([[0, 1]], np.int32), np.array([length]), k, np.array([0]), 2)
    scene = by_hand(clusters, [link], method=method(1, 1, h))
    stretched = np.array([[-0.1, 0.0, 0.0], [1.1, 0.0, 0.0]])
    found = end_state(scene, steps=40, start=start(scene, stretched)).position
    s, u = 0.2, 0.0
    for _ in range(40):
        after = (s + h * u) / (1 + 2 * k * h * h / m)
        s, u = after, (after - s) / h
    assert abs(s) > 0.005
    assert found[1, 0] - found[0, 0] - length == pytest.approx(s, abs=40 * 10 * 1.2 * 2.0**-53)
    assert found[0, 0] + found[1, 0] == pytest.approx(1.0, abs=1e-14)


def test_iterations_go_on_with_one_multiplier() -> None:
    """A lone link is solved in the first iteration, further ones change nothing: without multipliers they would stiffen."""
    clusters = clusters_of([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0]])
    link = LinkedCopies(np.array([[0, 1]], np.int32), np.array([1.0]), 70.0, np.array([0]), 2)
    ends = []
    for iterations in (1, 5):
        scene = by_hand(clusters, [link], method=method(1, iterations))
        begin = start(scene, [[-0.1, 0.0, 0.0], [1.1, 0.0, 0.0]])
        ends.append(end_state(scene, steps=20, start=begin).position)
    assert np.abs(ends[0] - ends[1]).max() < 20 * 5 * 10 * 2.0**-53


def test_colours_share_no_particle_and_copies_are_coloured_alike() -> None:
    links = bodies_scene(
        sheet=SHEET | {"copies": [3, 1, 2]}, bar=BAR | {"link_radius": 0.2, "link_stiffness": 9.0}
    ).body_set.links
    for number in range(links.colours):
        ends = links.ends[links.starts[number] : links.starts[number + 1]].ravel()
        assert len(np.unique(ends)) == len(ends)
    assert links.count == links.starts[-1] == len(np.unique(links.ends, axis=0))
    assert set(np.unique(links.compliance)) == {1 / 500.0, 1 / 9.0}
    assert make_links([]).colours == 0 and make_links([]).count == 0


def test_a_linked_body_runs_and_its_plan_says_so() -> None:
    scene = bodies_scene(bar=BAR | {"link_radius": 0.2, "link_stiffness": 9.0})
    plan = body_plan(scene, frozenset(LIVE))
    assert (
        "links" in plan.parts
        and sum("links" in stage.name for stage in plan.root.stages()) == scene.body_set.links.colours
    )
    assert "links" not in body_plan(bodies_scene(bar=BAR), frozenset(LIVE)).parts
    assert np.isfinite(end_state(scene, steps=3).position).all()


def test_a_step_that_changes_keeps_the_springs() -> None:
    """A finer step is a new compliance: where the bits are those of a scene of that step."""
    coarse, fine = hung(), hung().replace({"method.dt": 0.004})
    with opened(coarse) as simulation:
        simulation.set("method.dt", 0.004)
        simulation.advance(4)
        assert same(simulation.state(), end_state(fine, steps=4))


# ---------------------------------------------------------------------- sheets


def test_a_sheet_is_the_vertices_of_its_mesh() -> None:
    """Masses are thirds of triangles of 0.2 kg/m^2; its links all edges, its skin the mesh."""
    made = SoftSheet(particle_spacing=1 / 6).bake(Shape(name="sheet", resolution=6).mesh())
    assert len(made.position) == 49 and made.mass.sum() == pytest.approx(0.2)
    assert (
        made.mass.max() == pytest.approx(0.2 / 36 * 4 / 3) and made.report.links == 2 * 6 * 7 + 36
    )  # rows, columns, a diagonal a cell
    assert np.array_equal(made.skin.position, made.position)
    assert made.rest_length.max() == pytest.approx(2**0.5 / 6) and "a sheet" in made.report.lines()[0]
    assert made.report.orphans == 0 and (made.skin.normal @ [0.0, 1.0, 0.0] > 0.999).all()


def test_a_sheet_hangs_over_a_ball() -> None:
    """What cloth does: its middle rests on the ball, its rim below; nothing is stretched by a tenth."""
    ball = {
        "center": [0.0, -0.3, 0.0],
        "radius": 0.25,
        "thickness": 0.02,
        "static_friction": 0.5,
        "dynamic_friction": 0.4,
    }
    scene = Scene({"sheet": SHEET, "sphere": ball, "gravity": {}, "method": method(4, 1, 0.01)})
    position = end_state(scene, steps=150, precision="float32", math="fast").position
    links = scene.body_set.links
    length = np.linalg.norm(position[links.ends[:, 0]] - position[links.ends[:, 1]], axis=1)
    assert np.abs(length / links.rest_length - 1).max() < 0.1
    assert abs(position[:, 1].max() - (-0.03)) < 0.02 and position[:, 1].min() < -0.2


def test_a_mesh_without_triangles_is_told() -> None:
    with pytest.raises(InputError):
        SoftSheet(particle_spacing=0.1).bake((np.zeros((3, 3)), np.zeros((0, 3), np.int32)))
