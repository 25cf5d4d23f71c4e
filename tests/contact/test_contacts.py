"""A cloth's contacts with itself on the CPU: closed forms of one contact, laws of all of them, and the NumPy reference."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest
from contact_scenes import SPACING, crumpled, folded

from softlab.bench.reference.contact import self_contacts as reference
from softlab.cpu_backend.contact.self_contact import Contacts
from softlab.model.base.variant import plain_formulas
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS, table_size
from softlab.model.core.build import build, folded_positions
from softlab.model.formulas import contact
from softlab.model.scene.scene import Scene

EPS = float(np.finfo(np.float64).eps)


def planes(scene: Scene, points: np.ndarray, real: type = np.float64) -> np.ndarray:
    """(particles, 3) as the kernels take them: (3, rows, columns)."""
    grid = scene.grid
    return np.ascontiguousarray(points.T.reshape(3, grid.rows, grid.columns), dtype=real)


def points_of(planes: np.ndarray) -> np.ndarray:
    return planes.reshape(3, -1).T


def contacts_of(
    scene: Scene,
    before: np.ndarray,
    predicted: np.ndarray,
    weights: Any = None,
    real: type = np.float64,
    threads: int = 1,
) -> tuple[Contacts, np.ndarray]:
    """The contacts between two states, and the positions (particles, 3) after all sweeps, in exact math."""
    numba.set_num_threads(threads)
    weights = np.ones(len(before)) if weights is None else weights
    contacts = Contacts(scene, build(scene), real, "exact", threads, weights)
    contacts.find(planes(scene, before, real), planes(scene, predicted, real))
    position = planes(scene, predicted, real)
    contacts.project(position)
    return contacts, points_of(position)


def kept(contacts: Contacts, array: np.ndarray) -> np.ndarray:
    """Of an array of contacts those that are held, by mass."""
    held = np.arange(MAX_CONTACTS) < contacts.contact_counts[:, None]
    return array[held.ravel()]


# ---------------------------------------------------------------------- one triangle


def test_the_nearest_point_is_the_least_of_a_dense_sampling() -> None:
    """No point on a grid of 1/200 of the sides is nearer, and the nearest of them is as near to a grid step."""
    formulas, random = plain_formulas(contact, np.float64), np.random.default_rng(3)
    b, c = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, 201), np.linspace(0, 1, 201)))
    b, c = b[b + c <= 1], c[b + c <= 1]
    features = set()
    for _ in range(300):
        u, v, p = random.normal(size=(3, 3))
        feature, s, t = formulas.nearest(*u, *v, *p)
        features.add(feature)
        distance = np.linalg.norm(p - s * u - t * v)
        sampled = np.linalg.norm(p - b[:, None] * u - c[:, None] * v, axis=1).min()
        step = (np.linalg.norm(u) + np.linalg.norm(v)) / 200
        assert distance <= sampled + 8 * EPS and sampled <= distance + step
        assert s >= 0 and t >= 0 and s + t <= 1 + 4 * EPS
    assert features == set(range(7))


@pytest.mark.parametrize("degenerate", [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0)], ids=["point", "side", "line"])
def test_triangles_without_an_area_have_a_nearest_point_too(degenerate: tuple[float, float]) -> None:
    formulas, u = plain_formulas(contact, np.float64), np.array([1.0, 2.0, -1.0])
    u, v = u * degenerate[0], u * degenerate[1]
    p = np.array([0.3, 0.1, 2.0])
    _, s, t = formulas.nearest(*u, *v, *p)
    ends = np.array([0.0, degenerate[0], degenerate[1]])
    way = np.array([1.0, 2.0, -1.0])
    place = np.clip(p @ way / (way @ way), ends.min(), ends.max())
    assert np.linalg.norm(s * u + t * v - place * way) < 8 * EPS


def test_every_feature_has_one_owner() -> None:
    """Of all triangles around a corner or a side, exactly one answers for it: none is lost, none is counted twice."""
    rows, columns, owns = 4, 5, plain_formulas(contact, None).owns
    names = {(0,): contact.FIRST, (1,): contact.SECOND, (2,): contact.THIRD, (0, 1): contact.FIRST_SECOND}
    names |= {(0, 2): contact.FIRST_THIRD, (1, 2): contact.SECOND_THIRD}
    owners: dict[frozenset, int] = {}
    for number, corners in enumerate(reference.triangles(rows, columns).tolist()):
        i, j = divmod(number // 2, columns - 1)
        assert plain_formulas(contact, None).corners(np.int64(number), np.int64(columns)) == tuple(corners)
        for places, feature in names.items():
            key = frozenset(corners[place] for place in places)
            owners[key] = owners.get(key, 0) + int(owns(number % 2 == 1, feature, i, j))
    assert set(owners.values()) == {1}
    assert len(owners) == rows * columns + (rows * (columns - 1) + (rows - 1) * columns + (rows - 1) * (columns - 1))


# ---------------------------------------------------------------------- one contact


def over_a_triangle(
    height: float, way: tuple[float, float, float], **part: Any
) -> tuple[np.ndarray, np.ndarray, Contacts]:
    """A sheet of 2 x 4 masses 1 m apart, its last one laid `height` over a point of its first triangle, and moved by `way`:
    (before, after all sweeps, contacts)."""
    scene = folded(2, 4, layer=2, apart=1, self_collision={"thickness": 0.05, "sweeps": 1} | part)
    scene = scene.replace({"cloth.spacing": 1.0})
    before = np.array([(j, 0.0, i) for i in range(2) for j in range(4)])
    before[7] = 0.2 * before[0] + 0.5 * before[4] + 0.3 * before[5] + (0, height, 0)
    before[[2, 3, 6]] += (0.0, np.copysign(5.0, height), 0.0)  # out of the way
    predicted = before.copy()
    predicted[7] += way
    contacts, position = contacts_of(scene, before, predicted)
    return before, position, contacts


def test_one_contact_puts_the_mass_at_the_thickness_with_the_weights_of_the_corners() -> None:
    """C = h - d; moving along n by w_i g_i C / sum(g^2 w) with g = (1, -.2, -.5, -.3); Gershgorin's bound of a single contact
    is sum of |g| w load with loads |g|, here 1 + .04 + .25 + .09, the same: the constraint is met at once."""
    before, position, contacts = over_a_triangle(0.06, (0.0, -0.04, 0.0), static_friction=0.0, dynamic_friction=0.0)
    assert contacts.contact_counts[7] == 1 and contacts.contact_counts.sum() == 1
    gradient = np.zeros(8)
    gradient[[7, 0, 4, 5]] = 1, -0.2, -0.5, -0.3
    predicted_gap = 0.02
    expected = gradient * (0.05 - predicted_gap) / (gradient**2).sum()
    predicted = before.copy()
    predicted[7, 1] -= 0.04
    assert np.abs(position[:, 1] - predicted[:, 1] - expected).max() < 8 * EPS
    assert np.abs((position - predicted)[:, [0, 2]]).max() < EPS
    gap = position[7, 1] - 0.2 * position[0, 1] - 0.5 * position[4, 1] - 0.3 * position[5, 1]
    assert gap == pytest.approx(0.05, abs=8 * EPS)


@pytest.mark.parametrize("way", [-0.2, 0.2], ids=["through", "away"])
def test_a_contact_is_made_for_what_will_touch(way: float) -> None:
    """Twice the thickness away and more, a mass that would fly through in one substep is held on its side, whichever it
    is; one that flies away is left alone."""
    for side in (1.0, -1.0):
        before, position, _ = over_a_triangle(
            side * 0.11, (0.0, side * way, 0.0), static_friction=0.0, dynamic_friction=0.0
        )
        height = side * (position[7, 1] - 0.2 * position[0, 1] - 0.5 * position[4, 1] - 0.3 * position[5, 1])
        if way < 0:
            assert height == pytest.approx(0.05, abs=1e-15)
        else:
            assert np.array_equal(position[:7], before[:7])


def test_nothing_is_found_beyond_thickness_margin_and_motion() -> None:
    """thickness 5 cm and a tenth of it: 5.5 cm, plus the motion of 1 cm."""
    assert over_a_triangle(0.0649, (0.0, -0.01, 0.0))[2].contact_counts[7] == 1
    assert over_a_triangle(0.0651, (0.0, -0.01, 0.0))[2].contact_counts[7] == 0


@pytest.mark.parametrize(("slide", "static", "sticks"), [(0.005, 0.6, True), (0.02, 0.6, False)])
def test_friction_holds_in_its_cone_and_slows_beyond_it(slide: float, static: float, sticks: bool) -> None:
    """Depth 1 cm. Macklin 2014, eq. 24: a slide under static * depth is taken back; of a longer one dynamic * depth."""
    before, position, _ = over_a_triangle(0.05, (slide, -0.01, 0.0), static_friction=static, dynamic_friction=0.4)

    def across(p: np.ndarray) -> float:
        return float(p[7, 0] - 0.2 * p[0, 0] - 0.5 * p[4, 0] - 0.3 * p[5, 0])

    left = across(position) - across(before)
    assert left == pytest.approx(0.0 if sticks else slide - 0.4 * 0.01, abs=8 * EPS)


def test_an_overlap_is_reduced_no_faster_than_the_separation_speed() -> None:
    _, position, _ = over_a_triangle(0.02, (0.0, 0.0, 0.0), separation_speed=0.24)
    h = (1 / 60) / 4
    gap = position[7, 1] - 0.2 * position[0, 1] - 0.5 * position[4, 1] - 0.3 * position[5, 1]
    assert gap == pytest.approx(0.02 + 0.24 * h, abs=8 * EPS)


# ---------------------------------------------------------------------- all of them


@pytest.mark.parametrize("seed", range(4))
def test_what_is_found_and_projected_is_the_references(seed: int) -> None:
    scene = folded(12, 7, layer=4, self_collision={"thickness": 0.09, "sweeps": 1})
    before, predicted = crumpled(scene, seed)
    weights = np.random.default_rng(seed).choice([0.0, 0.5, 1.0], len(before))
    part: Any = scene.self_collision
    h = scene.method.dt / scene.method.substeps
    found = reference.find(part, 12, 7, SPACING, before, predicted, h)
    counts = np.bincount(found.mass, minlength=len(before))
    contacts, position = contacts_of(scene, before, predicted, weights)
    assert np.array_equal(contacts.contact_counts, counts) and counts.sum() > 500
    assert contacts.lost == np.maximum(counts - MAX_CONTACTS, 0).sum() > 0
    first = found.nearest(MAX_CONTACTS)
    assert np.array_equal(kept(contacts, contacts.triangles), first.triangle)
    values = kept(contacts, contacts.values)
    # normals are quotients of lengths of a few mm and more by differences of coordinates of 0.5 m
    assert np.abs(values[:, 2:5] - first.normal).max() < 0.5 / (0.0625 * 0.09) * 16 * EPS
    assert np.abs(values[:, 5] - first.required).max() < 64 * EPS
    expected = reference.project(part, first, before, predicted, weights)
    assert np.abs(position - expected).max() < 1e-13
    assert np.abs(position - predicted).max() > 0.01


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_threads_do_not_change_a_bit(real: type) -> None:
    scene = folded(12, 7, layer=4, self_collision={"thickness": 0.09})
    before, predicted = crumpled(scene)
    _, one = contacts_of(scene, before, predicted, real=real)
    for threads in (2, 3, 4):
        _, position = contacts_of(scene, before, predicted, real=real, threads=threads)
        assert np.array_equal(position, one)


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_contacts_keep_momentum(friction: float) -> None:
    """Every contact moves its mass by w s and its corners by -w b s: sum of m dp is 0 up to the rounding of each mass's
    place, half an ulp of 1 m, whatever the weights."""
    scene = folded(
        12, 7, layer=4, self_collision={"thickness": 0.09, "static_friction": friction, "dynamic_friction": friction}
    )
    before, predicted = crumpled(scene)
    weights = np.random.default_rng(5).choice([0.5, 1.0, 2.0], len(before))
    _, position = contacts_of(scene, before, predicted, weights)
    moved = (position - predicted) / weights[:, None]
    assert np.abs(moved.sum(axis=0)).max() < 4 * len(before) * EPS
    assert np.abs(moved).max() > 0.01


def test_sweeps_converge_to_the_thickness() -> None:
    """Two sheets approach each other: after many sweeps every gap that is held is met, and a sweep never leaves the worst
    depth larger than before by more than what corners share, Gershgorin's bound of the contacts' system."""
    scene = folded(8, 5, layer=4, self_collision={"thickness": 0.06, "static_friction": 0.0, "dynamic_friction": 0.0})
    before = build(scene.replace({"perturbation.amplitude": 0.0})).position.copy()
    predicted = before.copy()
    predicted[before[:, 1] > 0.05, 1] -= 0.07
    depths = []
    for sweeps in (1, 4, 16, 64, 256):
        changed = scene.replace({"self_collision.sweeps": sweeps})
        contacts, position = contacts_of(changed, before, predicted)
        values, corners = kept(contacts, contacts.values), kept(contacts, contacts.corners)
        mass = np.repeat(np.arange(len(before)), np.minimum(contacts.contact_counts, MAX_CONTACTS))
        weights = np.stack([1 - values[:, 0] - values[:, 1], values[:, 0], values[:, 1]], axis=1)
        offset = position[mass] - np.einsum("nk,nkd->nd", weights, position[corners])
        depths.append(float((values[:, 5] - np.einsum("nk,nk->n", values[:, 2:5], offset)).max()))
    assert depths == sorted(depths, reverse=True)
    assert depths[0] > 0.01 and depths[-1] < 1e-6


def test_layers_in_one_place_part_to_one_side() -> None:
    """Coincident layers have no side (B19): masses of a higher number than the triangle go up, the others down."""
    scene = folded(7, 5, layer=4, apart=0, perturbation={"amplitude": 0.0}, self_collision={"thickness": 0.06})
    start = folded_positions(scene.cloth, scene.fold)  # type: ignore[arg-type]
    assert np.allclose(start[:5], start[30:])
    _, position = contacts_of(scene, start, start)
    lower, upper = position[:10, 1], position[25:, 1]  # two rows and more from the hinge
    assert upper.min() > lower.max()


def test_a_pinned_sheet_is_not_moved() -> None:
    scene = folded(12, 7, layer=4, self_collision={"thickness": 0.09})
    before, predicted = crumpled(scene)
    _, position = contacts_of(scene, before, predicted, np.zeros(len(before)))
    assert np.array_equal(position, predicted)


def test_masses_far_off_and_not_finite_ones_end_the_search() -> None:
    scene = folded()
    before, predicted = crumpled(scene)
    for value in (np.nan, np.inf, 1e30, -1e9):
        broken = predicted.copy()
        broken[7] = value
        contacts_of(scene, before, broken)
        contacts_of(scene, broken, broken)


def test_tables_are_powers_of_two() -> None:
    assert [table_size(n) for n in (1, 2, 3, 5, 1000)] == [2, 4, 8, 16, 2048]


# ---------------------------------------------------------------------- layers that are apart


def passing(scene: Scene, lower: float, upper: float) -> tuple[np.ndarray, np.ndarray]:
    """(positions (rows, columns, 3), whether in the upper layer): a sheet folded in the middle, whose layers are tilted
    [degrees] about the fold's normal; the upper one begins before the lower one, the thickness and a millimetre above."""
    grid = scene.grid
    assert scene.self_collision is not None
    row, column = np.indices((grid.rows, grid.columns))
    top = row >= grid.rows // 2
    place = np.zeros((grid.rows, grid.columns, 3))
    for layer, angle in ((~top, np.radians(lower)), (top, np.radians(upper))):
        place[layer, 0] = (np.cos(angle) * column * SPACING)[layer]
        place[layer, 1] = (np.sin(angle) * column * SPACING)[layer]
    place[..., 2] = np.where(top, grid.rows - 1 - row, row) * SPACING
    place[top, 0] += place[~top, 0].min() - place[top, 0].max() - 0.03
    place[top, 1] += place[~top, 1].max() - place[top, 1].min() + scene.self_collision.thickness + 0.001
    return place, top


@pytest.mark.parametrize(
    ("lower", "upper"), [(0.0, 0.0), (10.0, 0.0), (0.0, 10.0), (0.0, 45.0)], ids=["flat", "lower", "upper", "steep"]
)
def test_layers_that_pass_by_are_not_pushed(lower: float, upper: float) -> None:
    """Nothing moves that lies two rows from the fold, where layers are tied. (Planes of contacts had no end and pushed
    by up to 10 mm in a substep.)"""
    rows = 8
    for thickness, stride in ((0.025, 0.0157), (0.005, 0.0157), (0.025, 0.05)):
        scene = folded(rows=rows, self_collision={"thickness": thickness})
        place, top = passing(scene, lower, upper)
        for step in range(round(0.9 / stride)):
            before, predicted = place.copy(), place.copy()
            before[top, 0] += stride * step
            predicted[top, 0] += stride * (step + 1)
            _, after = contacts_of(scene, before.reshape(-1, 3), predicted.reshape(-1, 3))
            pushed = np.abs(after.reshape(predicted.shape) - predicted)[[0, 1, rows - 2, rows - 1]]
            assert pushed.max() == 0, (thickness, stride, step)
