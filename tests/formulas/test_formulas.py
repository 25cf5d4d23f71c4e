"""The point-wise formulas, uncompiled: against the reference, and the identities they promise."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from softlab.bench.reference.philox import philox4x32, random_directions
from softlab.model.base.variant import plain_formulas
from softlab.model.core.integrators import INTEGRATORS, amplification_matrix
from softlab.model.formulas import integrators, random, springs

length = st.floats(-1e3, 1e3)
word64 = st.integers(0, 2**64 - 1)


@settings(deadline=None, max_examples=100)
@given(length, length, st.floats(0, 1e4))
def test_pull_is_antisymmetric_and_hookes(dx, dy, rest):
    """pull(-d) = -pull(d) to the last bit; and k (|d| - L0) d / |d|, to the rounding of k |d| and k L0."""
    pull = springs.spring_acceleration_2d
    stiffness = 10.0
    x, y = pull(dx, dy, stiffness, stiffness * rest)
    back = pull(-dx, -dy, stiffness, stiffness * rest)
    assert (x, y) == (-back[0], -back[1])
    distance = np.hypot(dx, dy)
    if distance > 1e-150:
        expected = stiffness * (distance - rest) * np.array([dx, dy]) / distance
        assert (x, y) == pytest.approx(tuple(expected), abs=1e-14 * stiffness * (distance + rest))


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_coincident_masses_do_not_pull(real):
    """B4, B15: no direction, no force. Where the squared length underflows (1e-23 squared in float32) the unit vector is
    lost, and what is left is stiffness times the distance: finite, and nothing beside any other force."""
    pull = plain_formulas(springs, real).spring_acceleration_2d
    assert pull(real(0), real(0), real(1000), real(1000)) == (0, 0)
    d = real(1e-23 if real is np.float32 else 1e-170)
    assert d * d == 0
    assert pull(d, real(0), real(1000), real(1000)) == (pytest.approx(1000 * d), 0)


@settings(deadline=None, max_examples=50)
@given(word64, word64, st.integers(0, 2**31 - 1))
def test_philox_is_the_references(seed, step, particle):
    words = random.philox(np.uint64(seed), np.uint64(step), np.uint64(particle))
    counter = np.array([step & 0xFFFFFFFF, step >> 32, particle, 0], dtype=np.uint64)
    assert [int(w) for w in words] == philox4x32(counter, (seed & 0xFFFFFFFF, seed >> 32)).tolist()


def test_a_damper_brakes_and_a_random_force_is_added():
    damped = springs.damped
    assert damped(1.5, 2.0, 0.25) == 1.0 and damped(0.0, -2.0, 0.25) == 0.5
    made, word = plain_formulas(random, np.float64), np.uint64(0xFFFFFFFF)
    assert made.add_external(1.0, 3.0, word) == 1 + 3 * made.uniform(word)


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_uniform_is_exact_in_both_precisions(real):
    """Odd multiples of 2^-23 fit into float32's 24 bits, so both precisions see the same random force, never +-1."""
    uniform = plain_formulas(random, real).uniform
    words = [0, 511, 512, 0xFFFFFFFF, 0x80000000, 123456789]
    values = [float(uniform(np.uint64(word))) for word in words]
    assert values == [(2 * (word >> 9) + 1) * 2.0**-23 - 1 for word in words]
    assert min(values) > -1 and max(values) < 1
    philox = random.philox
    drawn = [[float(uniform(w)) for w in philox(np.uint64(9), np.uint64(77), np.uint64(k))[:2]] for k in range(8)]
    assert np.array_equal(drawn, random_directions(9, 77, 8))


@settings(deadline=None, max_examples=50)
@given(st.floats(1e-4, 0.1), st.floats(0, 100), st.floats(0, 10), st.floats(-1, 1), st.floats(-10, 10))
@example(dt=1.0069e-4, w=9e-6, gamma=2.4e-5, x=-0.7523604875940124, v=0.0264)  # lab: the rounding of p' - p over dt
def test_formulas_are_the_amplification_matrices(dt, w, gamma, x, v):
    """One step of x'' = -w^2 x - gamma x' by each formula = amplification_matrix, which the limits are tested on.

    `lab` divides a difference of positions by dt, and with it the rounding of both, four operations of eps |p| each, in the
    formula and in the matrix.
    """
    make = plain_formulas(integrators, np.float64, {"damped": True})
    for name in INTEGRATORS:
        a = -w * w * x - gamma * v
        if name == "velocity-verlet":
            p, half = make.verlet_first_half(x, v, -w * w * x, dt, dt / 2, gamma)
            result = p, make.verlet_second_half(half, -w * w * p, dt / 2, 1 / (1 + dt * gamma / 2))
        elif name == "rk4":
            total, at = np.array([x, v]), np.array([x, v])
            for stage, (step, weight) in enumerate(zip((0.5, 0.5, 1, 1), (1, 2, 2, 1), strict=True)):
                rate = np.array([at[1], -w * w * at[0] - gamma * at[1]])
                at, total = make.rk4_stage(np.array([x, v]), rate, total, dt * step, dt * weight / 6)
                assert stage < 4
            result = tuple(total)
        else:
            result = make.variant(INTEGRATORS[name].step)(x, v, a, dt, dt * dt / 2)
        matrix = amplification_matrix(name, dt, w, gamma)
        scale = np.abs(matrix) @ np.abs([x, v]) + (1 + dt * w) ** 4 * (abs(x) * (1 + w) + abs(v)) + 1e-30
        allowed = 1e-12 * scale
        if name == "lab":
            allowed[1] += 2 * 4 * 2.0**-53 * (abs(x) + abs(result[0])) / dt
        assert np.all(np.abs(matrix @ [x, v] - result) <= allowed), name
