"""The judge of XPBD is judged first: closed forms, laws of its fixed points, convergence to the springs' own motion."""

from dataclasses import replace

import numpy as np
import pytest

from softlab.bench.reference import xpbd

G = 9.81
FRAME = 1 / 60
DOWN = np.array([0.0, -G])


def chain(links: int, length: float, compliance: float) -> xpbd.Constraints:
    return xpbd.sheet(links + 1, 1, {(1, 0): xpbd.Direction(length, compliance)})


def inverse(masses: np.ndarray) -> np.ndarray:
    """Inverse masses of a chain whose top is pinned."""
    w = 1 / masses
    w[0] = 0
    return w


def hang(constraints, y, masses, h, iterations, ordering, substeps, drag=0.0, gravity=DOWN):
    """(last substep, position before it, largest depth of the last mass) of a chain from rest at heights `y`."""
    position = np.stack([np.zeros_like(y), y], axis=-1)
    velocity, w, deepest = np.zeros_like(position), inverse(masses), -np.inf
    for _ in range(substeps):
        before = position
        state = xpbd.substep(constraints, position, velocity, gravity, w, h, iterations, ordering, drag)
        position, velocity = state.position, state.velocity
        deepest = max(deepest, -position[-1, 1])
    return state, before, deepest


def under(extensions: np.ndarray, length: float = 1.0) -> np.ndarray:
    """Heights of a chain with such extensions, from the top."""
    return -np.concatenate([[0.0], np.cumsum(length + extensions)])


@pytest.mark.parametrize("ordering", xpbd.ORDERINGS)
def test_one_damped_constraint_is_backward_euler(ordering):
    """Eq. 26: after one iteration v' = (v - h k x / m) / (1 + h c / m + h^2 k / m) of k 1000, c 7, m 2; residuals 0."""
    constraints, w, h = replace(chain(1, 1.0, 0.001), damping=np.array([7.0])), np.array([0.0, 0.5]), FRAME
    p, v = np.array([[0.0, 0.0], [1.5, 0.0]]), np.array([[0.0, 0.0], [3.0, 0.0]])
    for _ in range(30):
        state = xpbd.substep(constraints, p, v, 0.0, w, h, 1, ordering)
        expected = (v[1, 0] - h * 500 * (p[1, 0] - 1)) / (1 + h * 3.5 + h**2 * 500)
        assert state.velocity[1, 0] == pytest.approx(expected, abs=1e-13)
        assert max(xpbd.residuals(constraints, state, p, w, h)) < 1e-15
        p, v = state.position, state.velocity


def loads(masses: np.ndarray) -> np.ndarray:
    """What each link of a hanging chain carries [N]."""
    return G * np.cumsum(masses[:0:-1])[::-1]


@pytest.mark.parametrize("alpha", [0.0, 0.1])
@pytest.mark.parametrize("h", [FRAME, 1 / 600, 1 / 2400])
@pytest.mark.parametrize("n", [2, 10])
def test_steady_error_of_one_ascending_sweep(n, h, alpha):
    """At rest link i is g h^2 (n - i) too long: what the links below still move it after it was projected.

    So one sweep a substep leaves the last mass g h^2 n (n - 1) / 2 too low, whatever the compliance, and the multipliers
    are exact: -h^2 times the load. The steady state is put in, and one substep keeps it but for rounding.
    """
    masses = np.full(n + 1, 0.01)
    y = under(alpha * loads(masses) + G * h**2 * (n - np.arange(1, n + 1)))
    state, _, _ = hang(chain(n, 1.0, alpha), y, masses, h, 1, "ascending", 1)
    np.testing.assert_allclose(state.position[:, 1], y, rtol=0, atol=1e-14)
    np.testing.assert_allclose(state.multipliers / -(h**2), loads(masses), rtol=1e-15 / (h**2 * G))
    exact = -n - alpha * loads(masses).sum()
    assert state.position[-1, 1] == pytest.approx(exact - G * h**2 * n * (n - 1) / 2, abs=1e-13)


@pytest.mark.parametrize(("h", "depth"), [(FRAME, 10.122625), (1 / 600, 10.00122625), (1 / 1200, 10.000306563)])
def test_a_rigid_rope_comes_to_that_steady_state(h, depth):
    """The law is an attractor: from 1 % beside it, with drag 0.3/h, to half of the last digit given."""
    n, masses = 10, np.full(11, 0.01)
    near = under(G * h**2 * (n - np.arange(1, n + 1)) * 1.01)
    state, _, _ = hang(chain(n, 1.0, 0.0), near, masses, h, 1, "ascending", 400, drag=0.3 / h)
    assert -state.position[-1, 1] == pytest.approx(depth, abs=5e-9)


@pytest.mark.parametrize(("ordering", "factor"), [("gauss-seidel", 49 / 45), ("jacobi", 199 / 45)])
def test_other_orderings_keep_the_square_of_h(ordering, factor):
    """A rigid rope of 10: +8.9 % with the colours even-odd, 4.42 times as much by Jacobi, at every h."""
    n, masses = 10, np.full(11, 0.01)
    for h in (FRAME, 1 / 600):
        law = G * h**2 * n * (n - 1) / 2
        near = under(np.full(n, factor * law / n))
        state, _, _ = hang(chain(n, 1.0, 0.0), near, masses, h, 1, ordering, 1500, drag=0.3 / h)
        assert -state.position[-1, 1] - n == pytest.approx(factor * law, rel=1e-6)


@pytest.mark.parametrize("ordering", ["gauss-seidel", "ascending", "jacobi", "weighted-jacobi"])
def test_converged_stretch_is_hookes(ordering):
    """A4: bottom y -10.53955 and 0.981 N at the anchor, at any h, from that start; momentum is kept in the sum."""
    n, masses = 10, np.full(11, 0.01)
    for h, iterations in ((FRAME, 400), (1 / 600, 40)):
        y = under(0.1 * loads(masses))
        state, before, _ = hang(chain(n, 1.0, 0.1), y, masses, h, iterations, ordering, 3)
        assert state.position[-1, 1] == pytest.approx(-10.53955, abs=1e-11)
        assert -state.multipliers[0] / h**2 == pytest.approx(0.981, abs=1e-10)
        stretch, balance = xpbd.residuals(chain(n, 1.0, 0.1), state, before, inverse(masses), h)
        assert stretch < 1e-11 and balance < 1e-15


def test_averaged_jacobi_hangs_too_low():
    """It divides displacements, which is to multiply masses: at rest mass i weighs valence times as much.

    The chain of A4 hangs from 1.8639 N instead of 0.981, at -10.981 instead of -10.53955, and iterations do not help.
    """
    n, masses, constraints = 10, np.full(11, 0.01), chain(10, 1.0, 0.1)
    heavy = masses * constraints.valence(n + 1)
    y = under(0.1 * loads(heavy))
    assert y[-1] == pytest.approx(-10.981)
    for iterations in (300, 600):
        state, _, _ = hang(constraints, y, masses, FRAME, iterations, "averaged-jacobi", 2)
        assert state.position[-1, 1] == pytest.approx(y[-1], abs=1e-10)
        assert -state.multipliers[0] / FRAME**2 == pytest.approx(1.8639, abs=1e-9)


@pytest.mark.parametrize(("h", "kept"), [(1 / 60, 0.656777), (1 / 600, 0.940056), (1 / 1200, 0.968640)])
def test_a_rigid_dumbbell_loses_spin_by_a_law(h, kept):
    """The angle of a substep D becomes atan2(sin D, 2 - cos D); 2 pi rad/s keep that much after 1 s."""
    angle = 2 * np.pi * h
    p = np.array([[-0.5, 0.0], [0.5, 0.0]])
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    v = (p - p @ turn.T) / h
    for _ in range(round(1 / h)):
        expected = np.arctan2(np.sin(angle), 2 - np.cos(angle))
        state = xpbd.substep(chain(1, 1.0, 0.0), p, v, 0.0, np.ones(2), h, 1)
        new, v = state.position, state.velocity
        angle = np.arcsin(np.clip((p[1, 0] * new[1, 1] - p[1, 1] * new[1, 0]) * 4, -1, 1))
        assert angle == pytest.approx(expected, abs=1e-12)
        p = new
    assert angle / (2 * np.pi * h) == pytest.approx(kept, abs=6e-7)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 4), (4, 1), (2, 2), (7, 9)])
def test_no_colour_touches_a_mass_twice(rows, columns):
    ways = {way: xpbd.Direction(float(np.hypot(*way)), 0.1) for way in xpbd.COLOURS}
    constraints = xpbd.sheet(rows, columns, ways)
    for which in constraints.colours:
        touched = np.concatenate([constraints.first[which], constraints.second[which]])
        assert len(np.unique(touched)) == len(touched)
    p = np.stack([np.tile(np.arange(columns), rows), -np.repeat(np.arange(rows), columns)], axis=-1)
    d = p[constraints.second] - p[constraints.first]
    np.testing.assert_array_equal(np.hypot(*d.T), constraints.rest_length)
    assert len({tuple(sorted(pair)) for pair in zip(constraints.first, constraints.second, strict=True)}) == len(d)


@pytest.mark.parametrize("ordering", xpbd.ORDERINGS)
def test_coincident_and_pinned_masses_are_skipped(ordering):
    """No direction, no inverse mass: no NaN, no multiplier, and the next step goes on."""
    for length in (0.0, 1.0):
        constraints = chain(3, length, 0.1)
        p, w = np.array([[0.0, 0.0], [0.0, -2.0], [0.5, -3.0], [0.5, -3.0]]), np.array([0.0, 0.0, 1.0, 1.0])
        state = xpbd.substep(constraints, p, np.zeros_like(p), DOWN, w, 0.01, 1, ordering)
        assert state.multipliers[0] == 0
        assert state.multipliers[2] == 0 or ordering in ("gauss-seidel", "ascending")
        state = xpbd.substep(constraints, state.position, state.velocity, DOWN, w, 0.01, 5, ordering)
        assert np.isfinite(state.position).all() and np.isfinite(state.velocity).all()
        np.testing.assert_array_equal(state.position[:2], p[:2])
