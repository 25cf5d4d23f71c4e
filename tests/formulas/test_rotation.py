"""The nearest rotation in two and three dimensions: against the singular value decomposition for every kind of matrix that
clusters come to, what it returns where there are many, and its bits."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab.bench.stress.rotations import (
    best_trace,
    matrices_of,
    of_singular_values,
    off_rotation,
    quaternions,
    sets_of_matrices,
)
from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.variant import Variant, plain_formulas
from softlab.model.formulas import rotation

BOTH = pytest.mark.parametrize("real", [np.float32, np.float64])
VARIANTS = pytest.mark.parametrize(
    ("real", "math"), [(np.float32, "exact"), (np.float64, "exact"), (np.float32, "fast")]
)
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
COUNT = 10_000

# |b| of what counts as reached, what H may lack, and what rounding makes of them: see the head of rotation.py
TRACE = rotation.REACHED + rotation.SLACK + 16
ORTHOGONAL = {np.float32: 1e-6, np.float64: 1e-12}


@cache
def solver(real: Any, math: str = "exact") -> Any:
    """solve(A (n, 9), before (n, 4), whole) -> ((n, 4), (n,) bool): `rotation_3d`, or its near half and what it reached."""
    compiler = Compiler(f"rotation_{real.__name__}", math)
    formulas = compiler.formulas(rotation, real, inline=True)
    whole_one, near = formulas.rotation_3d, formulas.rotation_3d_near

    @numba.njit(**compiler.options)
    def loop(A, q, out, reached, whole):
        for k in range(len(A)):
            a, b = A[k], q[k]
            matrix, quaternion = (a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8]), (b[0], b[1], b[2], b[3])
            if whole:
                w, x, y, z = whole_one(matrix, quaternion)
            else:
                w, x, y, z, reached[k] = near(matrix, quaternion)
            out[k, 0], out[k, 1], out[k, 2], out[k, 3] = w, x, y, z

    def solve(A: np.ndarray, before: np.ndarray, whole: bool = True) -> tuple[np.ndarray, np.ndarray]:
        out, reached = np.empty((len(A), 4), real), np.zeros(len(A), bool)
        before = np.ascontiguousarray(np.broadcast_to(before, out.shape), real)
        loop(np.ascontiguousarray(A.reshape(-1, 9), real), before, out, reached, whole)
        return out, reached

    return solve


def multiplied(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """W. Hamilton's product, row by row."""
    pw, pu, qw, qu = p[:, :1], p[:, 1:], q[:, :1], q[:, 1:]
    return np.concatenate([pw * qw - (pu * qu).sum(1, keepdims=True), pw * qu + qw * pu + np.cross(pu, qu)], axis=1)


def turned(q: np.ndarray, degrees: float) -> np.ndarray:
    """Each by so much about an axis of its own."""
    half, axis = np.radians(degrees) / 2, np.random.default_rng(8).normal(size=(len(q), 3))
    axis *= np.sin(half) / np.linalg.norm(axis, axis=1, keepdims=True)
    return multiplied(q, np.concatenate([np.full((len(q), 1), np.cos(half)), axis], axis=1))


SETS = sets_of_matrices(COUNT)


def unscaled(A: np.ndarray, real: Any) -> np.ndarray:
    """float64, each matrix over its largest entry; 0 where that has no reciprocal in `real`."""
    largest = np.abs(A).max((1, 2), keepdims=True).astype(float)
    return np.divide(A, largest, out=np.zeros(A.shape), where=largest > 4 * float(np.finfo(real).tiny))


def assert_nearest(A: np.ndarray, q: np.ndarray, real: Any) -> None:
    """Rotations, each nearest to its matrix (n, 3, 3) as `real` holds it."""
    A, R = unscaled(A.astype(real), real), formula_matrices(q, real)
    length = np.linalg.norm(q.astype(float), axis=1)
    assert np.abs(length - 1).max(initial=0) <= 1.25 * np.finfo(real).eps + 4 * np.finfo(float).eps
    apart, determinant = off_rotation(R)
    assert apart < ORTHOGONAL[real] and determinant < 3 * ORTHOGONAL[real]
    missing = best_trace(A) - (matrices_of(q) * A).sum((1, 2))
    assert np.abs(missing).max(initial=0) <= TRACE * np.finfo(real).eps


def formula_matrices(q: np.ndarray, real: Any) -> np.ndarray:
    """(n, 3, 3) by the formula, on whole arrays."""
    return np.stack(plain_formulas(rotation, real).matrix_of(*q.T), axis=1).reshape(-1, 3, 3).astype(float)


@VARIANTS
@pytest.mark.parametrize("name", SETS)
def test_it_is_the_rotation_of_the_singular_value_decomposition(name: str, real: Any, math: str) -> None:
    """From no turn, from any turn, and from where it is found; whatever the scale."""
    A, solve = SETS[name], solver(real, math)
    before = quaternions(np.random.default_rng(5), len(A))
    for start, scale in ((IDENTITY, 1.0), (before, 1e-12), (before, 1e12)):
        q, _ = solve(scale * A, start)
        assert q.dtype == real
        assert_nearest(scale * A, q, real)
    again, _ = solve(1e12 * A, q)
    assert_nearest(1e12 * A, again, real)


@BOTH
def test_the_near_half_knows_whether_it_is_there(real: Any) -> None:
    """What it says is reached is; else it returns what it was given; and what it has left, the whole one goes on from."""
    for A in SETS.values():
        before = turned(solver(real)(A, IDENTITY)[0].astype(float), 70).astype(real)
        (q, reached), (whole, _) = solver(real)(A, before, False), solver(real)(A, before)
        assert_nearest(A[reached], q[reached], real)
        assert np.array_equal(q[~reached], before[~reached])
        assert np.array_equal(q[reached], whole[reached])


@BOTH
def test_the_near_half_is_enough_from_thirty_degrees(real: Any) -> None:
    """Of bodies stretched by a third at most, all; of random matrices, mirrored ones and flat ones, all but a thousandth."""
    random = np.random.default_rng(4)
    bodies = of_singular_values(random, random.uniform(2 / 3, 4 / 3, (COUNT, 3)))
    for A, least in ((bodies, 1.0), (SETS["random, half of them mirrored"], 0.999), (SETS["flat"], 0.999)):
        q, _ = solver(real)(A, IDENTITY)
        assert solver(real)(A, turned(q.astype(float), 30), False)[1].mean() >= least


@BOTH
def test_named_cases(real: Any) -> None:
    """NUMERICS A10: a half turn, where H is negative and b is 0 from the start; a mirrored body; a flat one; none."""
    half_turn, mirrored = np.diag([-1.0, -1.0, 1.0]), -np.diag([3.0, 2.0, 1.0])
    for A, expected in ((half_turn, half_turn), (mirrored, half_turn), (np.diag([1.0, 1.0, 0.0]), np.eye(3))):
        R = formula_matrices(solver(real)(A[None], IDENTITY)[0], real)[0]
        assert np.abs(R - expected).max() <= 4 * np.finfo(real).eps
    before = quaternions(np.random.default_rng(6), 100).astype(real)
    for nothing in (0.0, np.finfo(real).smallest_subnormal, np.finfo(real).tiny):  # too small for a reciprocal
        assert np.array_equal(solver(real)(np.full((100, 9), nothing, real), before)[0], before)


@BOTH
def test_a_power_of_two_leaves_the_bits(real: Any) -> None:
    A = np.concatenate([each[:500] for each in SETS.values()]).astype(real)
    before = quaternions(np.random.default_rng(5), len(A))
    q, _ = solver(real)(A, before)
    for power in (-40, 40):
        assert np.array_equal(solver(real)(np.ldexp(A, power), before)[0], q)


@BOTH
def test_what_rests_keeps_its_bits(real: Any) -> None:
    """Called again with its own result it stays, be it one of many: also when A's entries are all rounded anew."""
    A = np.concatenate([SETS[name][:1000] for name in ("rigid", "on a line", "flat", "mirrored")]).astype(real)
    q, _ = solver(real)(A, IDENTITY)
    for _ in range(3):
        q, _ = solver(real)(A, q)
    assert np.array_equal(solver(real)(A, q)[0], q)
    b = np.stack(seen_from(A.astype(float), q))
    quiet = np.linalg.norm(b, axis=0) < 4 * np.finfo(real).eps * np.abs(A).max((1, 2))
    assert quiet.mean() > 0.3
    side = np.random.default_rng(2).choice([-np.inf, np.inf], A.shape).astype(real)
    # each entry by eps at most: S by 3 eps, b by sqrt(3) of its differences; under 8 + rounding where it was small
    moved = solver(real)(np.nextafter(A, side), q)[0]
    assert (moved[quiet] == q[quiet]).all(axis=1).mean() > 0.9
    assert np.abs((moved * q).sum(1) - 1).max() < (1 / 64) ** 2  # and otherwise by a hundredth, about a line


def seen_from(A: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, ...]:
    S = matrices_of(q).swapaxes(1, 2) @ A
    return S[:, 2, 1] - S[:, 1, 2], S[:, 0, 2] - S[:, 2, 0], S[:, 1, 0] - S[:, 0, 1]


@BOTH
def test_of_many_it_is_the_nearest_to_the_one_before(real: Any) -> None:
    """A cluster on a line, A = a r': any rotation with R r along a will do; nearest to the one before is the shortest arc
    from where that has the line. The far half's start leaves out what is beyond 136 degrees or so."""
    random = np.random.default_rng(9)
    a, r = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in random.normal(size=(2, 2000, 3)))
    before = quaternions(random, len(a))
    was = np.einsum("nij,nj->ni", matrices_of(before), r)
    cosine = (was * a).sum(1)
    arc = np.concatenate([1 + cosine[:, None], np.cross(was, a)], axis=1)  # the half angle's, times 2 cos
    expected = multiplied(arc / np.linalg.norm(arc, axis=1, keepdims=True), before)
    q, _ = solver(real)(a[:, :, None] * r[:, None, :], before)
    close = cosine > np.cos(np.radians(120))
    # `before` has moved by rounding; what A leaves open is turned by 1/64 at most
    assert 1 - np.abs((q * expected).sum(1))[close].min() < (1 / 64) ** 2


def cluster_matrix(now: np.ndarray, rest: np.ndarray, real: Any) -> np.ndarray:
    now, rest = (now - now.mean(0)).astype(real), (rest - rest.mean(0)).astype(real)
    return sum(np.outer(a, b) for a, b in zip(now, rest, strict=True)).astype(real)[None]


@BOTH
@pytest.mark.parametrize("shape", ["flat", "line", "pair", "point"])
def test_goals_of_degenerate_clusters_are_exact(shape: str, real: Any) -> None:
    """B20: a sheet, a line, two points and one, turned anyhow: goals are where the points are, to 1e-6 of their size or, in
    float64, 1e-14: |b| <= 16 eps turns by 16 eps / 2 (s2 + s3), s2 being 0.5 or more of the largest entry, where it moves
    points at all."""
    i, j = np.meshgrid(np.arange(4.0), np.arange(4.0) * 0.75, indexing="ij")
    flat = np.stack([i.ravel(), j.ravel(), 0 * i.ravel()], axis=1) / 3
    rest = {"flat": flat, "line": flat[::4], "pair": flat[:2], "point": flat[:1]}[shape]
    for start in quaternions(np.random.default_rng(1), 50):
        R = matrices_of(start[None])[0]
        now = rest @ R.T
        q, _ = solver(real)(cluster_matrix(now, rest, real), IDENTITY)
        goals = (rest - rest.mean(0)) @ formula_matrices(q, real)[0].T
        assert np.abs(goals - (now - now.mean(0))).max() < {np.float32: 2e-6, np.float64: 1e-14}[real]
        if shape == "point":
            assert np.array_equal(q[0], IDENTITY)


entry = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 0.5, 1e-30, 3.0, 1 + 2**-20]), st.floats(-1e30, 1e30), st.floats(-1, 1)
)


@settings(deadline=None, max_examples=300)
@given(st.lists(entry, min_size=9, max_size=9), st.lists(st.floats(-1, 1), min_size=4, max_size=4))
def test_of_any_matrix_it_is_the_nearest(entries: list[float], start: list[float]) -> None:
    before = np.array(start) if any(start) else IDENTITY
    before = before / np.abs(before).max()  # some are below 1e-154, and their squares nothing
    before /= np.linalg.norm(before)
    for real in (np.float32, np.float64):
        A = np.array(entries, real).reshape(1, 3, 3)
        q, _ = solver(real)(A, before)
        assert_nearest(A, q, real)


@settings(deadline=None, max_examples=300)
@given(st.lists(entry, min_size=4, max_size=4), st.floats(-3.2, 3.2))
def test_in_two_dimensions(entries: list[float], angle: float) -> None:
    """s1 + sign(det) s2 = |(xx + yy, yx - xy)|, to what is kept and rounding; what is given where that is 0."""
    for real in (np.float32, np.float64):
        a, given_one = np.array(entries, real), (real(np.cos(angle)), real(np.sin(angle)))
        c, s = plain_formulas(rotation, real).rotation_2d(*a, *given_one)
        assert type(c) is real and type(s) is real
        eps, A = np.finfo(real).eps, unscaled(a.reshape(1, 2, 2), real)[0]
        assert abs(float(c) ** 2 + float(s) ** 2 - 1) < 4 * eps
        best = np.hypot(A[0, 0] + A[1, 1], A[1, 0] - A[0, 1])
        missing = best - (c * (A[0, 0] + A[1, 1]) + s * (A[1, 0] - A[0, 1]))
        # kept: the one given may be any; of two numbers up to 4 the products' and the sum's rounding
        assert abs(missing) <= (2 * rotation.UNCHANGED + 8) * eps
        # (s1 + sign(det) s2)^2 = |A|^2 + 2 det A, in rational numbers: LAPACK loses 35 roundings near a mirror
        w, x, y, z = map(Fraction, A.ravel().tolist())
        exact = math.sqrt(w * w + x * x + y * y + z * z + 2 * (w * z - x * y))
        assert abs(best - exact) <= 4 * np.finfo(float).eps * exact + 1e-150  # squares below 1e-308 are nothing
        if best == 0:
            assert (c, s) == given_one


@BOTH
def test_mirrors_and_nothing_keep_the_turn_in_two_dimensions(real: Any) -> None:
    rotation_2d, before = plain_formulas(rotation, real).rotation_2d, (real(0.6), real(0.8))
    turns = np.random.default_rng(4).uniform(-4, 4, 200)
    for scale in (1e-12, 1.0, 1e12, 0.0):
        for c, s in zip(np.cos(turns), np.sin(turns), strict=True):
            mirror = [real(scale * v) for v in (c, s, s, -c)]
            assert rotation_2d(*mirror, *before) == before
            if scale:
                found = rotation_2d(*[real(scale * v) for v in (c, -s, s, c)], *before)
                assert np.abs(np.subtract(found, (c, s))).max() <= 2 * np.finfo(real).eps
    nothing = rotation_2d(real(1e-42), real(0), real(0), real(1e-42), *before)
    assert nothing == (before if real is np.float32 else (1, 0))


@BOTH
def test_quaternions_turn_as_their_matrices(real: Any) -> None:
    """To rounding: of four products of up to 1 and their sums, 8 units."""
    random, formulas = np.random.default_rng(3), plain_formulas(rotation, real)
    q, v = quaternions(random, 500).astype(real), random.uniform(-1, 1, (500, 3)).astype(real)
    eps, exact = np.finfo(real).eps, matrices_of(q)
    assert np.abs(formula_matrices(q, real) - exact).max() < 8 * eps
    found = np.stack(formulas.rotated(*q.T, *v.T), axis=1)
    assert found.dtype == real
    assert np.abs(found - np.einsum("nij,nj->ni", exact, v)).max() < 8 * np.sqrt(3) * eps
    assert np.array_equal(formula_matrices(IDENTITY[None].astype(real), real)[0], np.eye(3))


@BOTH
def test_compiled_formulas_give_the_bits_of_plain_python(real: Any) -> None:
    plain, random = plain_formulas(rotation, real), np.random.default_rng(7)
    A = np.concatenate([each[:: len(each) // 12] for each in SETS.values()]).astype(real)
    before = quaternions(random, len(A)).astype(real)
    q, _ = solver(real)(A, before)
    near, reached = solver(real)(A, before, False)
    assert 0.1 < reached.mean() < 0.9
    flat, two = plain.rotation_2d, Variant(real, numba.njit(error_model="numpy"))(rotation.rotation_2d)
    for k, a in enumerate(A.reshape(-1, 9)):
        alone = plain.rotation_3d(a, before[k])
        assert all(type(v) is real for v in alone)
        assert np.array_equal(alone, q[k])
        assert np.array_equal(plain.rotation_3d_near(a, before[k]), [*near[k], reached[k]])
        assert flat(*a[:4], *before[k, :2]) == two(*a[:4], *before[k, :2])
