"""Bodies from meshes: their clusters, what is refused with what would do, and what a baked body is."""

import re

import numpy as np
import pytest
from closed_meshes import ball, both, box, rotation, soft
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab.model.assets.clustering import (
    COLLINEAR,
    RIM,
    ceiled,
    centres,
    falloff,
    gather,
    least_radius,
    one_cluster,
    undetermined,
)
from softlab.model.assets.soft_body import DENSITY, RigidBody, SoftBody
from softlab.model.base.errors import SceneError, SoftlabError
from softlab.model.geometry.shapes import Shape
from softlab.model.geometry.solid import solid


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.integers(1, 80), st.floats(0.05, 3.0), st.floats(0.05, 3.0))
def test_clusters(seed, count, spacing, radius):
    """Centres no nearer than the spacing to one another, everyone nearer than that to one; members are all within the
    radius; coefficients fall from 1 to RIM."""
    position = np.random.default_rng(seed).uniform(0, 1, (count, 3))
    chosen = centres(position, spacing)
    every = np.linalg.norm(position[:, None] - position[chosen], axis=2)
    assert every.min(axis=1).max() < spacing
    among = every[chosen] + np.diag(np.full(len(chosen), np.inf))
    assert among.min() >= spacing
    found = gather(position, np.ones(count), spacing, radius, 5.0)
    assert found.count == len(chosen)
    for k in range(found.count):
        some = slice(found.offsets[k], found.offsets[k + 1])
        assert np.array_equal(found.indices[some], np.flatnonzero(every[:, k] <= radius))
        assert np.allclose(found.coefficients[some], falloff(every[found.indices[some], k] / radius))
    assert ((found.coefficients >= RIM) & (found.coefficients <= 1)).all()
    assert (found.stiffness == 5.0).all()
    assert len(found.orphans) == (every.min(axis=1) > radius).sum()


def test_the_falloff():
    part = np.linspace(0, 1, 1001)
    assert (falloff(part)[0], falloff(part)[-1]) == (1.0, RIM)
    assert (np.diff(falloff(part)) < 0).all()
    assert np.abs(np.diff(falloff(part))).max() * 1000 < 2  # no step: 8 / (3 sqrt 3) (1 - RIM) at most


def refused_radius(mesh, **more) -> tuple[str, float]:
    with pytest.raises(SceneError, match=r"use at least ([0-9.e-]+), or a smaller cluster_spacing") as refused:
        soft(mesh, **more)
    assert refused.value.field == "cluster_radius"
    return str(refused.value), float(re.search(r"at least ([0-9.e-]+),", str(refused.value))[1])


@pytest.mark.parametrize("name", ["star", "torus", "blob", "octopus"])
def test_orphans_are_refused_with_the_radius_that_would_do(name):
    """The radius told does, and the next smaller one of three digits does not."""
    mesh = Shape(name=name, resolution=32).mesh()
    message, radius = refused_radius(mesh, cluster_radius=0.12)
    count = int(re.search(r"(\d+) of (\d+) particles are in no cluster, and the body would fall apart", message)[1])
    held = soft(mesh, cluster_radius=radius)
    assert held.report.orphans == 0
    assert held.report.parts == 1
    away = np.linalg.norm(held.position[:, None] - held.position[centres(held.position, 0.25)], axis=2).min(axis=1)
    assert count == (away > 0.12).sum()
    unit = 10.0 ** (np.floor(np.log10(radius)) - 2)
    with pytest.raises(SceneError):
        soft(mesh, cluster_radius=radius - 1.01 * unit)


def test_clusters_that_share_too_little_are_refused():
    """Every particle its own cluster: no orphans, and nothing that holds. Cells are an eighth apart: from there on it
    does; or with links of that length."""
    bar = box((1.0, 0.25, 0.25))
    sampling = {"volume_sampling": 1.0, "surface_sampling": 0.0, "particle_spacing": 0.125, "cluster_spacing": 0.125}
    message, radius = refused_radius(bar, cluster_radius=0.05, **sampling)
    assert "would fall into 32 parts" in message
    assert radius == 0.125
    assert soft(bar, cluster_radius=radius, **sampling).report.parts == 1
    linked = soft(bar, cluster_radius=0.05, link_radius=0.125, link_stiffness=100.0, **sampling)
    assert linked.report.parts == 1
    assert linked.report.undetermined == linked.report.clusters == 32
    assert any("32 of 32 clusters have fewer than 4 particles" in line for line in linked.report.lines())


def test_pieces_apart_move_apart():
    two = both(box((0.4, 0.4, 0.4)), box((0.4, 0.4, 0.4), (2.0, 0, 0)))
    report = soft(two).report
    assert (report.parts, report.pieces, report.orphans) == (2, 2, 0)
    assert any("2 parts are not connected" in line for line in report.lines())
    near = both(box((0.4, 0.4, 0.4)), box((0.4, 0.4, 0.4), (0.5, 0, 0)))
    report = soft(near, cluster_radius=0.4).report
    assert report.parts == 1
    assert any("2 pieces move together" in line for line in report.lines())


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.integers(2, 60), st.floats(0.05, 0.6), st.integers(1, 4))
def test_the_least_radius_is_the_least(seed, count, spacing, pieces):
    """Enough with it, not enough with the next smaller float."""
    from softlab.model.assets.clustering import check

    position = np.random.default_rng(seed).uniform(0, 1, (count, 3))
    none = np.zeros((0, 2), np.int32)
    radius = least_radius(position, none, spacing, pieces)

    def checked(radius):
        return check(gather(position, np.ones(count), spacing, radius, 1.0), none, spacing, radius, pieces)

    if radius > 0:
        assert 1 <= checked(radius) <= pieces
        assert 1 <= checked(ceiled(radius)) <= pieces
        with pytest.raises(SceneError):
            checked(np.nextafter(radius, 0))


@settings(deadline=None)
@given(st.floats(1e-9, 1e9))
def test_rounding_up(value):
    assert value <= ceiled(value) < value * 1.0101
    assert float(f"{ceiled(value):g}") == ceiled(value)


def test_undetermined_clusters():
    """Three particles, a line, a line that is a little bent; four in a plane have a rotation."""
    line = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], axis=1)
    bent = line + np.array([[0, 0, 0]] * 3 + [[0, 0.1, 0]] + [[0, 0, 0]] * 2)
    square = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    for position, count in ((line, 1), (bent, 0), (square, 0), (square[:3], 1), (line[:1], 1)):
        assert undetermined(one_cluster(position, np.ones(len(position)))) == count
    assert undetermined(one_cluster(line + np.outer(range(6), [0, 2 * COLLINEAR, 0]), np.ones(6))) == 1  # straight
    turned = (line + np.array([0.3, 0.1, 0.7])) @ rotation((0.4, 1.0, -0.3)).T
    assert undetermined(one_cluster(turned, np.ones(6))) == 1


def test_a_soft_body():
    mesh = Shape(name="star").mesh()
    found = soft(mesh, link_radius=0.15, link_stiffness=300.0)
    count = len(found.position)
    assert (found.position.dtype, found.mass.shape, found.spacing) == (np.float64, (count,), 0.1)
    assert np.isclose(found.mass.sum(), DENSITY * solid(mesh, 0.1).volume, rtol=1e-12)
    assert found.mass.min() > 0.2 * found.mass.mean()
    assert found.clusters.mass is found.mass
    assert found.clusters.position is found.position
    every = np.linalg.norm(found.position[:, None] - found.position[None], axis=2)
    assert np.array_equal(found.links, np.argwhere(np.triu(every <= 0.15, 1)))
    assert (found.links.dtype, found.link_stiffness) == (np.int32, 300.0)
    assert np.array_equal(found.rest_length, every[tuple(found.links.T)])
    assert np.array_equal(found.skin.position, mesh.position)
    assert np.array_equal(found.skin.triangles, mesh.triangles)
    assert np.array_equal(found.skin.rest_centre, found.clusters.rest_centre)
    report = found.report
    assert report.particles == count == report.interior + report.surface
    assert report.overlap == len(found.clusters.indices) / count
    assert report.members == (np.diff(found.clusters.offsets).min(), np.diff(found.clusters.offsets).max())
    assert (report.links, report.orphans, report.parts) == (len(found.links), 0, 1)
    assert 0.97 < report.covered <= 1
    assert re.match(rf"{count} particles \(\d+ inside, \d+ on the surface\), about 0.1 m apart", report.lines()[0])
    assert re.search(r"orphans: 0; links: \d+", report.lines()[1])


def test_a_rigid_body():
    found = RigidBody.from_mesh(ball(), particle_spacing=0.1, mass=3.0)
    clusters = found.clusters
    assert (clusters.count, clusters.stiffness.tolist(), len(found.links)) == (1, [np.inf], 0)
    assert np.array_equal(clusters.indices, np.arange(len(found.position)))
    assert (clusters.coefficients == 1).all()
    assert np.isclose(found.mass.sum(), 3.0, rtol=1e-12)
    assert (found.skin.clusters == 0).all()
    assert (found.skin.weights == [1, 0, 0, 0]).all()
    assert found.report.parts == 1
    assert RigidBody.from_mesh(ball(), particle_spacing=0.9).report.particles >= 1


def test_the_same_on_every_call():
    mesh = Shape(name="blob").mesh()
    one, other = soft(mesh), soft(mesh)
    for name in ("position", "mass", "links", "rest_length"):
        assert np.array_equal(getattr(one, name), getattr(other, name))
    for name in ("offsets", "indices", "coefficients"):
        assert np.array_equal(getattr(one.clusters, name), getattr(other.clusters, name))
    assert one.report == other.report


@pytest.mark.parametrize(
    ("fields", "field", "words"),
    [
        ({"particle_spacing": 0.0}, "particle_spacing", "greater than 0"),
        ({"particle_spacing": float("nan")}, "particle_spacing", "finite"),
        ({"particle_spacing": "fine"}, "particle_spacing", "must be a number"),
        ({"volume_sampling": 0.0, "surface_sampling": 0.0}, "volume_sampling", "no particles"),
        ({"volume_sampling": 0.5}, "volume_sampling", "from 1"),
        ({"volume_sampling": 9.0}, "volume_sampling", "to 8"),
        ({"surface_sampling": -1.0}, "surface_sampling", "at least 0"),
        ({"cluster_spacing": 0.05}, "cluster_spacing", "at least particle_spacing, 0.1"),
        ({"cluster_radius": 0.0}, "cluster_radius", "greater than 0"),
        ({"cluster_stiffness": float("inf")}, "cluster_stiffness", "finite"),
        ({"link_radius": 0.1}, "link_stiffness", "no links"),
        ({"link_stiffness": 10.0}, "link_radius", "no links"),
        ({"density": 2.0, "mass": 3.0}, "density", "density or mass"),
        ({"stiffness": 2.0}, "stiffness", "unknown key"),
    ],
)
def test_parameters_that_cannot_be(fields, field, words):
    with pytest.raises(SceneError, match=words) as refused:
        soft(ball(), **fields)
    assert refused.value.field == field


SAMPLED = ("volume_sampling", "surface_sampling")
NUMBER = st.floats(1e-3, 3.0) | st.sampled_from([0.0, 0.05, 0.2])


@settings(deadline=None, max_examples=40)
@given(
    st.fixed_dictionaries(
        {"particle_spacing": st.floats(0.08, 2.0)},
        optional={name: NUMBER for name in ("cluster_spacing", "cluster_radius", *SAMPLED, "link_radius")},
    ),
    st.sampled_from(["ball", "box", "plate", "two"]),
)
def test_anything_makes_a_body_or_a_reason(fields, name):
    """Never a traceback of another kind, never an orphan or a NaN."""
    meshes = {
        "ball": ball(halvings=1),
        "box": box((0.5, 0.3, 0.8)),
        "plate": box((1.0, 1.0, 1e-3)),
        "two": both(box(), box((0.2, 0.2, 0.2), (0.9, 0.9, 0.9))),
    }
    try:
        found = SoftBody.from_mesh(
            meshes[name], **fields, **({"link_stiffness": 1.0} if fields.get("link_radius") else {})
        )
    except SoftlabError as error:
        assert len(str(error)) > 20
        return
    assert found.report.orphans == 0
    assert np.isfinite(found.position).all()
    assert (found.mass > 0).all()
    assert np.allclose(found.skin.weights.sum(axis=1), 1, rtol=0, atol=1e-14)
