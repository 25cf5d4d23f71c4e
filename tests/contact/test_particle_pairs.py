"""What contacts between bodies are searched and held by, from a scene's numbers alone: no kernel, milliseconds."""

from __future__ import annotations

import numpy as np
import pytest
from bodies_scenes import SAMPLED, bodies_scene, method
from meeting_bodies import meeting, neighbours

from softlab.model.contact.particle_parameters import (
    G_ACTIVE,
    G_DISTANCE,
    G_NEIGHBOURS,
    G_PULL,
    G_SEARCH_RADIUS,
    G_SELF_DISTANCE,
    H_INVERSE_CELL,
    pair_rows,
    particle_contact_record,
)  # fmt: skip
from softlab.model.scene.scene import Scene

SOFT = {"kind": "soft_body", "particle_spacing": 0.16, **SAMPLED}


def two(**of_the_second: object) -> Scene:
    """Two bars of particles 0.16 m apart, one of them finer and sticky."""
    one = SOFT | {"group": 1}
    other = SOFT | {"particle_spacing": 0.12, "adhesion": 3.0, "group": 2, "origin": [2.0, 0.0, 0.0]}
    return bodies_scene(one=one, other=other | of_the_second, method=method(2, 1), contact={"adhesion_reach": 0.25})


def test_distances_are_the_sums_of_radii_and_adhesion_reaches_farther() -> None:
    scene = two()
    one, other = scene.bodies["one"], scene.bodies["other"]
    rows, radii = pair_rows(scene), np.array([one.contact_radius, other.contact_radius])
    np.testing.assert_allclose(rows[:, :, G_DISTANCE], radii[:, None] + radii)
    sticky = np.array([[False, True], [True, True]])
    np.testing.assert_allclose(rows[:, :, G_ACTIVE], rows[:, :, G_DISTANCE] * np.where(sticky, 1.25, 1.0))
    h = scene.method.dt / 2
    np.testing.assert_allclose(rows[:, :, G_PULL], np.where(sticky, 3.0 * h * h, 0.0))
    assert (rows[:, :, G_SEARCH_RADIUS] > rows[:, :, G_ACTIVE]).all() and (
        rows[:, :, G_SEARCH_RADIUS] < 1.5 * rows[:, :, G_ACTIVE]
    ).all()
    assert (rows[:, :, G_NEIGHBOURS] >= rows[:, :, G_DISTANCE]).all()
    np.testing.assert_array_equal(rows, rows.transpose(1, 0, 2))


@pytest.mark.parametrize(("avoids", "meets"), [([], True), ([1], False), ([7], True)])
def test_groups_that_avoid_each_other_do_not_meet(avoids: list[int], meets: bool) -> None:
    rows = pair_rows(two(avoids=avoids))
    assert (rows[0, 1, G_DISTANCE] > 0) == (rows[1, 0, G_DISTANCE] > 0) == meets
    assert (rows[[0, 1], [0, 1], G_DISTANCE] > 0).all()


def test_only_who_meets_itself_has_a_distance_of_its_own() -> None:
    """A soft body does unless it is told not to."""
    for told, own in (({}, True), ({"self_collision": False}, False)):
        rows = pair_rows(two(**told))
        assert rows[:, :, G_SELF_DISTANCE].tolist() == [[rows[0, 0, G_DISTANCE], 0], [0, own * rows[1, 1, G_DISTANCE]]]


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_a_cell_is_as_large_as_the_longest_search(real: type) -> None:
    """So that all whom a particle may meet lie in the 27 cells around it; a larger one would only cost time."""
    scene = two()
    cell = 1 / float(particle_contact_record(scene, real)[H_INVERSE_CELL])
    longest = float(pair_rows(scene)[:, :, G_SEARCH_RADIUS].max())
    assert longest * (1 - 1e-6) <= cell <= 1.01 * longest


def test_whom_particles_may_meet_is_asked_by_distance_alone() -> None:
    """By hand: of three particles in a row the middle one is within reach of both, whatever the cells."""
    scene = meeting()
    reach = pair_rows(scene)[0, 1, G_SEARCH_RADIUS]
    body = scene.body_set.body
    first, second = int(np.flatnonzero(body == 0)[0]), int(np.flatnonzero(body == 1)[0])
    position = 100.0 + 10 * reach * np.arange(len(body))[:, None] * np.ones(3)
    for apart, met in ((0.999, True), (1.001, False)):
        for shift in np.linspace(0, reach, 7):  # wherever the borders of cells lie
            position[first] = shift
            position[second] = position[first] + [apart * reach, 0.0, 0.0]
            found = neighbours(scene, position, np.ones(len(body)), np.float64)
            assert (found[first], found[second]) == (([second], [first]) if met else ([], []))
