"""Where each explicit step stops being stable: the table of docs/method/cases.md A1, and runs on both sides of the limit."""

from math import inf, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab.app.driver import open_simulation
from softlab.bench.reference import mass_spring as reference
from softlab.model.base.errors import UnstableTimeStep
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import INTEGRATORS, amplification_matrix, frequency_bound
from softlab.model.scene.scene import Scene, load_scene

NAMES = list(INTEGRATORS)


def radius(name: str, dt: float, w: float, gamma: float) -> float:
    return float(np.abs(np.linalg.eigvals(amplification_matrix(name, dt, w, gamma))).max())


@pytest.mark.parametrize(
    ("name", "at_rest", "any_state"),
    [  # (gamma 0, gamma 3) at w^2 = 4000 and at w^2 = 8000
        ("lab", (0.0447214, 0.0439776), (0.0316228, 0.0312500)),
        ("semi-implicit-euler", (0.0316228, 0.0308817), (0.0223607, 0.0219888)),
        ("velocity-verlet", (0.0316228, 0.0316228), (0.0223607, 0.0223607)),
        ("rk4", (0.0447214, 0.045427), (0.0316228, 0.031992)),
        ("explicit-euler", (0, 0.00075), (0, 0.000375)),
        ("taylor", (0, 0.0015), (0, 0.00075)),
    ],
)
def test_table_of_limits(name, at_rest, any_state):
    """A1's table to its printed digits (the damped RK4 entries, found numerically there, to 2e-4)."""
    for squared, row in ((4000.0, at_rest), (8000.0, any_state)):
        for gamma, printed in zip((0.0, 3.0), row, strict=True):
            tolerance = 2e-4 if name == "rk4" and gamma else 2e-5
            assert INTEGRATORS[name].limit(sqrt(squared), gamma) == pytest.approx(printed, rel=tolerance)


@pytest.mark.parametrize(
    ("name", "printed"),
    [
        ("lab", 0.992472),
        ("semi-implicit-euler", 0.984886),
        ("rk4", 0.982217),
        ("taylor", 1.170470),
        ("explicit-euler", 1.330413),
    ],
)
def test_table_of_spectral_radii(name, printed):
    """A1's growth per step at the lab's own dt = 0.01, w^2 = 8000, gamma = 3; fact 3: taylor grows by 15.7 1/s."""
    found = radius(name, 0.01, sqrt(8000), 3.0)
    assert found == pytest.approx(printed, abs=1e-6)
    if name == "taylor":
        assert np.log(found) / 0.01 == pytest.approx(15.7, abs=0.05)


@settings(deadline=None, max_examples=200)
@given(st.sampled_from(NAMES), st.floats(0.1, 1e3), st.just(0.0) | st.floats(1e-2, 1e3))
def test_limit_is_the_edge_of_every_slower_mode(name, w, gamma):
    """Just under the limit no frequency from 0 to w grows; just over it, one does (where there is a limit at all)."""
    limit = INTEGRATORS[name].limit(w, gamma)
    frequencies = np.concatenate([[1e-6 * w], np.linspace(0, w, 200)[1:]])
    if 0 < limit < inf:
        assert max(radius(name, 0.999 * limit, f, gamma) for f in frequencies) <= 1 + 1e-9
        assert max(radius(name, 1.002 * limit, f, gamma) for f in frequencies) > 1
    elif limit == 0:  # unstable at every step size: without a damper Euler's and taylor's modes always grow
        assert gamma == 0
        assert radius(name, 0.1 / w, w, gamma) > 1


def test_the_labs_own_limit_is_a_32nd_of_a_second():
    """8000 dt^2 + 6 dt - 8 = 0 has the root 1/32 exactly (docs/method/cases.md, fact 2): 3.125 times the default."""
    assert stability_limit(load_scene("lab-grid")) == pytest.approx(0.03125, rel=1e-14)
    scene = load_scene("lab-grid").replace({"grid.rows": 4, "grid.columns": 4})
    open_simulation(scene.replace({"method.dt": 0.03125})).close()
    with pytest.raises(UnstableTimeStep) as refused:
        open_simulation(scene.replace({"method.dt": 0.0313}))
    assert refused.value.limit == pytest.approx(0.03125)
    open_simulation(scene.replace({"method.dt": 0.0313}), allow_unstable=True).close()


@pytest.mark.parametrize(("rows", "columns"), [(10, 10), (1, 30), (2, 2), (1, 1), (7, 2)])
def test_frequency_bound_holds_for_any_state(rows, columns):
    """w^2 <= k/m lambda_max(Laplacian) (A1), checked on the force's own Jacobian at random states."""
    scene = load_scene("lab-grid").replace({"grid.rows": rows, "grid.columns": columns})
    random = np.random.default_rng(1)
    bound = frequency_bound(scene)
    for scale in (1.0, 100.0):
        position = scale * (reference.rest(scene) + 0.3 * random.standard_normal((rows, columns, 2)))
        count = position.size
        jacobian = np.empty((count, count))
        for k in range(count):
            h = np.zeros(count)
            h[k] = 1e-6 * scale
            ends = [reference.spring_forces(scene, position + s * h.reshape(position.shape)) for s in (1, -1)]
            jacobian[:, k] = ((ends[0] - ends[1]) / (2e-6 * scale)).ravel()
        fastest = -np.linalg.eigvalsh((jacobian + jacobian.T) / 2)[0] / scene.grid.mass
        assert fastest <= bound**2 * (1 + 1e-6) + 1e-3


LINKS = 10
CHAIN = sqrt(1000 * 4) * sin((2 * LINKS - 1) * np.pi / (2 * (2 * LINKS + 1)))  # 1/s, its fastest mode (A1)


def zero_length_chain(name: str, dt: float, gamma: float) -> Scene:
    """Springs without rest length make a net exactly linear; hung at the top, free below, no gravity."""
    return Scene(
        {
            "grid": {"rows": LINKS + 1, "columns": 1, "pinned": "top"},
            "springs": {"rest_length": 0.0},
            "damping": {"coefficient": 0.01 * gamma},
            "method": {"integrator": name, "dt": dt},
        }
    )


def fastest_mode() -> np.ndarray:
    """Its shape along the chain, (LINKS + 1, 2), of amplitude 1 m in both axes: sin((2n-1) pi i / (2n+1))."""
    shape = np.sin((2 * LINKS - 1) * np.pi * np.arange(LINKS + 1) / (2 * LINKS + 1))
    return np.stack([shape, -shape], axis=1) / np.abs(shape).max()


CASES = [(n, g) for n in NAMES for g in (0.0, 3.0) if INTEGRATORS[n].limit(CHAIN, g) > 0]


@pytest.mark.parametrize(("name", "gamma"), CASES)
@pytest.mark.parametrize("side", [0.99, 1.01])
def test_runs_on_both_sides_of_the_limit(run, start_at, name, gamma, side, kernel):
    """The chain in its fastest mode does exactly what M^n (1, 0) says, M = amplification_matrix: under the limit it
    decays (gamma > 0) or stays bounded, over it it grows. Tolerance: rounding, n eps, times the growth and the factor
    w by which a position error enters the velocity."""
    dt = side * INTEGRATORS[name].limit(CHAIN, gamma)
    scene, shape, steps = zero_length_chain(name, dt, gamma), fastest_mode(), 50
    state = run(scene, steps, kernel=kernel, live=("damping", "gravity"), initial=start_at(scene, shape))
    powers = [np.linalg.matrix_power(amplification_matrix(name, dt, CHAIN, gamma), n) for n in range(steps + 1)]
    growth = max(float(np.abs(power).max()) for power in powers)
    tolerance = 100 * steps * 2.2e-16 * growth
    assert np.abs(state.position - powers[-1][0, 0] * shape).max() < tolerance
    assert np.abs(state.velocity - powers[-1][1, 0] * shape).max() < tolerance * CHAIN
    largest = radius(name, dt, CHAIN, gamma)
    if side > 1:
        assert largest > 1
        assert growth > 10 or name in ("explicit-euler", "taylor")  # whose growth per step is 1 % of a small damping
    else:
        assert largest < 1 if gamma else largest < 1 + 1e-9
