"""Normal modes of the pre-stretched lattice with all edges fixed (docs/method/cases.md A5): closed-form frequencies."""

from math import cos, pi, sin, sqrt

import numpy as np
import pytest

from softlab.bench.reference.mass_spring import rest
from softlab.model.core.integrators import amplification_matrix
from softlab.model.scene.scene import Scene

ROWS, COLUMNS, STRETCH, AMPLITUDE = 9, 13, 1.25, 1e-6


def lattice(name: str, dt: float) -> Scene:
    return Scene(
        {
            "grid": {"rows": ROWS, "columns": COLUMNS, "spacing": STRETCH, "pinned": "edges"},
            "springs": {},
            "method": {"integrator": name, "dt": dt},
        }
    )


def frequency(p: int, q: int) -> float:
    """w of the x-displacement sin(p pi j / (M - 1)) sin(q pi i / (N - 1)) [1/s]: the springs along x pull with k, those
    across it with their tension, k (1 - L0 / d)."""
    along = sin(p * pi / (2 * (COLUMNS - 1))) ** 2
    across = (1 - 1 / STRETCH) * sin(q * pi / (2 * (ROWS - 1))) ** 2
    return sqrt(4 / 0.01 * 10.0 * (along + across))


def shape(p: int, q: int) -> np.ndarray:
    i, j = np.mgrid[:ROWS, :COLUMNS]
    return np.sin(p * pi * j / (COLUMNS - 1)) * np.sin(q * pi * i / (ROWS - 1))


def projected(run, start_at, name: str, dt: float, steps: int, p: int, q: int, axis: int = 0) -> float:
    """The mode's amplitude after `steps`, over the one it started with."""
    scene, mode = lattice(name, dt), shape(p, q)
    position = rest(scene).astype(np.float64)
    position[..., axis] += AMPLITUDE * mode
    state = run(scene, steps, initial=start_at(scene, position), live=("damping", "gravity"))
    moved = (state.position.reshape(ROWS, COLUMNS, 2) - rest(scene))[..., axis]
    return float(np.sum(moved * mode) / np.sum(mode * mode) / AMPLITUDE)


MODES = [(1, 1, 9.929578763, -0.4032992), (3, 2, 26.513085923, 0.5565506), (11, 7, 68.566781065, 0.4112370)]


@pytest.mark.parametrize(("p", "q", "w", "ratio"), MODES)
def test_mode_moves_as_its_cosine(run, start_at, p, q, w, ratio):
    """cos(w t) at 0.2 s. RK4 at 1e-3: phase error t w (h w)^4 / 120 = 3e-6 for the fastest, damping t h^5 w^6 / 144 =
    1.4e-7... below 3e-6 in all; nonlinearity (amplitude / spacing)^2 and its coupling, 1e-6 of the amplitude."""
    assert frequency(p, q) == pytest.approx(w, abs=5e-9)
    assert cos(w * 0.2) == pytest.approx(ratio, abs=1e-7)
    assert projected(run, start_at, "rk4", 1e-3, 200, p, q) == pytest.approx(ratio, abs=5e-6)


@pytest.mark.parametrize("name", ["lab", "semi-implicit-euler", "velocity-verlet", "rk4"])
@pytest.mark.parametrize(("p", "q"), [(1, 1), (11, 7)])
def test_mode_follows_the_steps_own_matrix(run, start_at, name, p, q):
    """At the lab's dt = 0.01, 20 steps are M^20 (1, 0); to 1e-6: rounding of p ~ 15 m over 1e-6 m is 2e-9 a step."""
    expected = np.linalg.matrix_power(amplification_matrix(name, 0.01, frequency(p, q), 0.0), 20)[0, 0]
    assert projected(run, start_at, name, 0.01, 20, p, q) == pytest.approx(expected, abs=1e-6)


def test_y_modes_swap_the_two_stiffnesses(run, start_at):
    """A displacement in y with (p, q): the springs along y pull with k, so w has the two roles swapped."""
    p, q = 2, 3
    along = sin(q * pi / (2 * (ROWS - 1))) ** 2
    across = (1 - 1 / STRETCH) * sin(p * pi / (2 * (COLUMNS - 1))) ** 2
    w = sqrt(4000 * (along + across))
    assert projected(run, start_at, "rk4", 1e-3, 200, p, q, axis=1) == pytest.approx(cos(w * 0.2), abs=5e-6)


@pytest.mark.parametrize(("p", "q", "printed"), [(1, 1, 9.933662553), (3, 2, 26.591361560), (11, 7, 69.986394916)])
def test_semi_implicit_eulers_frequency(p, q, printed):
    """A5's numerical frequencies at dt = 0.01, acos(1 - (h w)^2 / 2) / h, are the angles of M's eigenvalues."""
    eigenvalue = np.linalg.eigvals(amplification_matrix("semi-implicit-euler", 0.01, frequency(p, q), 0.0))[0]
    assert abs(np.angle(eigenvalue)) / 0.01 == pytest.approx(printed, abs=5e-8)  # its own digits hold to 3e-8
