"""What lies inside a mesh, what lies near what, and the particles that follow: against slow searches and closed forms."""

import numpy as np
import pytest
from closed_meshes import area_of, ball, both, box, rotation, turned_over, volume_of
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import octahedron

from softlab.model.assets.sampling import CLOSEST, COVERED_WITHIN, MAX_PARTICLES, sample
from softlab.model.base.errors import InputError, SceneError
from softlab.model.geometry.mesh import triangle_mesh
from softlab.model.geometry.neighbours import TooMany, close_pairs, nearest, pairs_within, spread
from softlab.model.geometry.shapes import Shape
from softlab.model.geometry.solid import solid
from softlab.model.geometry.voxels import lattice, runs_inside, winding_numbers

ANGLE = st.floats(-3, 3)
VECTOR = st.tuples(ANGLE, ANGLE, ANGLE)


def inside(mesh, pitch):
    found = [place for _, place in runs_inside(*mesh, pitch).points()]
    return np.concatenate([np.zeros((0, 3)), *found])


def every_point(mesh, pitch):
    origin, counts = lattice(mesh[0], pitch)
    return origin + np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), -1).reshape(-1, 3) * pitch


def check_inside(mesh, pitch):
    """The same points, in the same order, as solid angles say, wherever all places a millionth away have the same."""
    points = every_point(mesh, pitch)
    around = [winding_numbers(points + 1e-6 * np.array(way), *mesh) for way in ((1, 2, 3), (-2, 1, -1), (1, -3, -2))]
    winding = np.rint(around)
    clear = (np.abs(np.array(around) - winding) < 1e-3).all(axis=0) & (winding == winding[0]).all(axis=0)
    assert clear.mean() > 0.5
    found = {tuple(point) for point in inside(mesh, pitch)}
    held = np.array([tuple(point) in found for point in points])
    assert np.array_equal(held[clear], winding[0][clear] > 0)
    assert np.array_equal(points[held], inside(mesh, pitch))


@settings(deadline=None, max_examples=40)
@given(VECTOR, st.floats(0.17, 0.6), st.booleans())
def test_inside_against_solid_angles(vector, pitch, two):
    position, triangles = octahedron()
    mesh = position @ rotation(vector).T, triangles
    if two:  # overlapping, and one of them with edges along the lattice
        mesh = both(mesh, box((0.9, 0.7, 1.3), (0.4, 0.2, 0.1)))
    check_inside(mesh, pitch)


@pytest.mark.parametrize("name", ["star", "torus", "blob"])
def test_inside_of_concave_shapes(name):
    mesh = Shape(name=name, resolution=24).mesh()
    check_inside((mesh.position, mesh.triangles), 0.11)


@settings(deadline=None, max_examples=40)
@given(VECTOR, st.integers(1, 40))
def test_every_column_is_left_as_often_as_entered(vector, count):
    """Vertices on lattice points, sides and faces along columns: no run begins without an end, none spills over."""
    position, triangles = octahedron()
    snapped = np.rint(position @ rotation(vector).T * 3) / 3
    runs = runs_inside(snapped, triangles, 1 / count)
    assert (runs.low < runs.high).all()
    _, counts = lattice(snapped, 1 / count)
    assert (runs.high <= counts[2]).all()
    assert (runs.low >= 0).all()


@pytest.mark.parametrize("cells", [(8, 2, 2), (1, 1, 1), (5, 3, 1)])
def test_a_box_of_whole_pitches_has_its_cells_centres(cells):
    size = np.array(cells) * 0.125
    points = inside(box(size, (0.3, -2.0, 5.0)), 0.125)
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), -1).reshape(-1, 3)
    assert np.allclose(points, (grid + 0.5) * 0.125 - size / 2 + [0.3, -2.0, 5.0], rtol=0, atol=1e-14)


@pytest.mark.parametrize("pitch", [0.1, 0.05, 0.02])
def test_volume_from_points(pitch):
    """The cells about the points inside and the body differ by what lies within half a cell's diagonal of the surface."""
    mesh = ball(halvings=3)
    found = runs_inside(*mesh, pitch)
    slab = 3**0.5 / 2 * pitch
    bound = 2 * slab * area_of(mesh) + 4 * np.pi / 3 * slab**3 * 2
    assert abs(found.count * pitch**3 - volume_of(mesh)) < bound
    assert (found.least, found.most) == (0, 1)


def test_overlaps_and_cavities():
    one = both(box(), box(middle=(0.5, 0.25, 0.25)))
    runs = runs_inside(*one, 0.1)
    assert (runs.least, runs.most) == (0, 2)
    assert abs(runs.count * 1e-3 - (2 - 0.5 * 0.75**2)) < 2 * area_of(one) * 0.1 * COVERED_WITHIN
    hollow = both(box(), turned_over(box((0.6, 0.6, 0.6))))
    assert runs_inside(*hollow, 0.1).count == 1000 - 216
    assert (runs_inside(*turned_over(box()), 0.1).count, runs_inside(*turned_over(box()), 0.1).least) == (0, -1)


POINTS = st.lists(st.tuples(*[st.floats(-2, 2, width=16)] * 3), max_size=40).map(lambda p: np.array(p).reshape(-1, 3))


@settings(deadline=None, max_examples=150)
@given(POINTS, POINTS, st.floats(0.01, 5))
def test_pairs_against_all(queries, points, radius):
    query, point, distance = pairs_within(queries, points, radius)
    every = np.linalg.norm(queries[:, None] - points[None], axis=2)
    wanted = np.argwhere(every <= radius)
    assert np.array_equal(np.stack([query, point], axis=1), wanted.reshape(-1, 2))
    assert np.array_equal(distance, every[query, point])
    one, other, _ = close_pairs(points, radius)
    among = np.linalg.norm(points[:, None] - points[None], axis=2)
    assert np.array_equal(np.stack([one, other], axis=1), np.argwhere(np.triu(among <= radius, 1)).reshape(-1, 2))
    if len(points):
        index, least = nearest(queries, points)
        assert np.array_equal(index, every.argmin(axis=1))
        assert np.array_equal(least, every.min(axis=1))


def test_too_many_pairs_are_refused_before_they_are_made(monkeypatch):
    points = np.random.default_rng(0).random((400, 3))
    monkeypatch.setattr("softlab.model.geometry.neighbours.MAX_PAIRS", len(pairs_within(points, points, 0.2)[0]) - 1)
    with pytest.raises(TooMany, match="smaller radius"):
        pairs_within(points, points, 0.2)


@settings(deadline=None, max_examples=150)
@given(POINTS, POINTS, st.floats(0.05, 2), st.booleans())
def test_spread_is_apart_and_full(candidates, taken, distance, urgent):
    """And greedy in its order: what is left out has one near to it that came first."""
    urgency = np.arange(len(candidates)) % 3 if urgent else None
    chosen = spread(candidates, taken, distance, urgency)
    kept = np.concatenate([taken, candidates[chosen]])
    among = np.linalg.norm(candidates[chosen][:, None] - kept[None], axis=2)
    among[np.arange(len(chosen)), len(taken) + np.arange(len(chosen))] = np.inf
    assert (among >= distance).all()
    out = np.delete(np.arange(len(candidates)), chosen)
    away = np.linalg.norm(candidates[out][:, None] - kept[None], axis=2)
    assert (away.min(axis=1, initial=np.inf) < distance).all()
    if urgent:
        away[:, len(taken) :][urgency[out][:, None] > urgency[chosen][None]] = np.inf
        assert (away.min(axis=1, initial=np.inf) < distance).all()


def particles(mesh, spacing, volume=2.0, surface=4.0):
    return sample(solid(triangle_mesh(*mesh), spacing), spacing, volume, surface)


def least_distance(position):
    return close_pairs(position, 2 * np.ptp(position, axis=0).max())[2].min()


SHAPES = {
    "star": {},
    "torus": {},
    "beam": {},
    "blob": {},
    "octopus": {"resolution": 32},
    "letters": {"text": "SO", "resolution": 16},
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize(("volume", "surface"), [(2.0, 4.0), (1.0, 0.0), (0.0, 3.0), (3.5, 1.0)])
def test_particles_keep_apart_and_fill(name, volume, surface):
    """None nearer than CLOSEST spacings to another, those inside inside, and the same again; of the finer lattice inside no
    point is left for which there would be room."""
    spacing = 0.09
    mesh = Shape(name=name, **{"resolution": 24, **SHAPES[name]}).mesh()
    body = solid(mesh, spacing)
    found = sample(body, spacing, volume, surface)
    assert found.interior + found.surface == len(found.position)
    assert (found.interior == 0) == (volume == 0)
    assert (found.surface == 0) == (surface == 0) or name == "beam"
    assert least_distance(found.position) >= CLOSEST * spacing
    inner = winding_numbers(found.position[: found.interior : 7], body.position, body.triangles)
    assert (inner > 0.5).all()
    if volume > 1:
        tried = inside((body.position, body.triangles), spacing / volume)
        assert nearest(tried, found.position[: found.interior])[1].max() < CLOSEST * spacing
    again = sample(body, spacing, volume, surface)
    assert np.array_equal(found.position, again.position)
    assert np.array_equal(found.volume, again.volume)


def test_a_full_lattice_gets_no_more():
    """A beam of whole spacings: cell centres, however fine the sampling; every cell of the same volume."""
    found = particles(box((1.0, 0.25, 0.25)), 0.125, 4.0, 8.0)
    assert (found.interior, found.surface, found.covered) == (32, 0, 1.0)
    assert np.allclose(found.volume, 0.125**3, rtol=1e-12)


THIN = {"plate": (1.0, 1.0, 0.01), "needle": (1.0, 0.004, 0.004), "ribbon": (1.0, 0.2, 1e-5)}


@pytest.mark.parametrize("name", THIN)
@settings(deadline=None, max_examples=10)
@given(VECTOR)
def test_thin_parts_get_particles(name, vector):
    """Wherever they lie: every place of the middle plane or line is near to a particle. Places tried are about half a
    spacing apart along a needle and 0.3 on a plate, in long triangles less evenly: nothing is farther than 1.5 spacings."""
    size = np.array(THIN[name])
    position, triangles = box(size)
    turn = rotation(vector)
    found = particles((position @ turn.T, triangles), 0.08)
    assert least_distance(found.position) >= CLOSEST * 0.08
    steps = [np.linspace(-0.5, 0.5, 41 if length > 0.08 else 1) * length for length in size]
    middle = np.stack(np.meshgrid(*steps, indexing="ij"), -1).reshape(-1, 3)
    assert nearest(middle @ turn.T, found.position)[1].max() < 1.5 * 0.08
    assert np.isclose(found.volume.sum(), size.prod(), rtol=1e-9)


def test_volumes_add_up_and_balance():
    """Each particle's volume is that of the places nearest to it: the centre of mass is off by at most the farthest of
    them, and by symmetry by far less: of a body of n particles by about that over sqrt(n)."""
    position, triangles = ball()
    turn = rotation((0.3, 0.5, 0.2))
    found = particles((position @ turn.T + [3, 4, 5], triangles), 0.08)
    assert np.isclose(found.volume.sum(), volume_of((position, triangles)), rtol=1e-12)
    centre = np.average(found.position, axis=0, weights=found.volume)
    assert np.linalg.norm(centre - [3, 4, 5]) < 2 * CLOSEST * 0.08 / len(found.position) ** 0.5
    assert found.volume.min() > 0
    assert found.volume.max() < 8 * 0.08**3  # all lies within CLOSEST of a particle: a ball of 3 cubes, at most


def test_sizes_that_cannot_be_are_refused_before_memory_is_taken():
    body = solid(triangle_mesh(*ball()), 0.1)
    with pytest.raises(SceneError, match=r"larger than the mesh, 1 m; at most 0.25") as refused:
        sample(body, 1.5, 2.0, 4.0)
    assert refused.value.field == "particle_spacing"
    assert len(sample(body, 0.25, 2.0, 4.0).position) > 8
    for spacing in (1e-3, 1e-4, 1e-30):
        with pytest.raises(SceneError, match=r"use at least ([0-9.e-]+)") as refused:
            sample(body, spacing, 2.0, 4.0)
        assert refused.value.field == "particle_spacing"
    with pytest.raises(SceneError, match=rf"{MAX_PARTICLES} at most; use at least 0.00\d+ for this mesh"):
        sample(body, 1e-3, 1.0, 0.0)
    with pytest.raises(SceneError, match=r"use at most") as refused:
        sample(body, 0.02, 2.0, 1e8)
    assert refused.value.field == "surface_sampling"
    with pytest.raises(InputError, match="surface_sampling over 0"):
        sample(solid(Shape(name="torus").mesh(), 0.9), 0.9, 1.0, 0.0)
