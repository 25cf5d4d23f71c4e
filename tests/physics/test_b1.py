"""Springs of which every second one is stiffer, and hard case B1, a chain of them: both backends' kernels against the NumPy
reference and each other, energies, the largest frequency, what a run over its limit is told."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.bench.reference import mass_spring as reference
from softlab.model.base.errors import UnstableTimeStep
from softlab.model.core.energy import energies
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import INTEGRATORS, amplification_matrix, damping_rate, frequency_bound
from softlab.model.core.stability.limit import MAX_MASSES, largest_frequency, scene_frequency, scene_net
from softlab.model.core.stability.springs import spring_ends, spring_stiffness
from softlab.model.mass_spring.plan import mass_spring_plan
from softlab.model.scene.scene import Scene, load_scene

RATIO = 7.0
EPSILON = {"float64": 2.0**-53, "float32": 2.0**-24}
# odd and even sides, pins inside rows, a start away from rest; at a step size that RATIO allows
UNEVEN = {"grid.rows": 11, "grid.columns": 18, "springs.stiffness_ratio": RATIO, "external.magnitude": 0.05}
LIVE = ("poke",)


def uneven(name: str = "velocity-verlet", **changes: object) -> Scene:
    scene = load_scene("lab-hammock").replace(UNEVEN | {"method.integrator": name} | changes)
    return scene.replace({"method.dt": min(0.005, 0.5 * stability_limit(scene))})


# ---------------------------------------------------------------------- the part


def test_a_ratio_of_one_is_no_part_and_no_text():
    """Scenes of equal springs keep the canonical text by which stores know them."""
    plain = load_scene("lab-grid")
    assert "stiffness_ratio" not in plain.canonical()
    assert plain.replace({"springs.stiffness_ratio": 1.0}).canonical() == plain.canonical()
    assert "alternating" not in mass_spring_plan(plain).parts
    scene = plain.replace({"springs.stiffness_ratio": 4.0})
    assert Scene(scene.as_dict()).springs == scene.springs and scene.springs.largest_stiffness == 40.0
    plan, bare = mass_spring_plan(scene), mass_spring_plan(plain)
    assert plan.parts - bare.parts == {"alternating"} and plan.root == bare.root


# ---------------------------------------------------------------------- kernels


@pytest.mark.parametrize(
    ("name", "precision"),
    [("lab", "float64"), ("velocity-verlet", "float64"), ("rk4", "float64"), ("semi-implicit-euler", "float32")],
)
def test_both_executions_are_the_reference(run, name, precision, kernel):
    """100 steps of all parts at once; few variants, since each takes seconds to compile. Tolerance, as in
    tests/mass_spring/test_cpu_reference.py: a step rounds p a few times by eps |p|, damped errors at most add, so 4 n eps
    |p|; velocities dt w^2 + 1 / dt times as much."""
    scene = uneven(name)
    state = run(scene, 100, kernel=kernel, precision=precision, live=LIVE)
    position, velocity = reference.simulate(scene, 100)
    dt, w = scene.method.dt, frequency_bound(scene)
    allowed = 4 * 100 * EPSILON[precision] * 18 * 1.5
    assert np.abs(state.position - position).max() < allowed
    assert np.abs(state.velocity - velocity).max() < allowed * (dt * w * w + 1 / dt)
    equal = reference.simulate(scene.replace({"springs.stiffness_ratio": 1.0}), 100)[0]
    assert np.abs(equal - position).max() > 1e-3  # not vacuous


def test_a_live_stiffness_keeps_the_ratio():
    scene = uneven()
    with open_simulation(
        scene, math="exact", precision="float64", kernel="fused", live=(*LIVE, "stiffness")
    ) as simulation:
        simulation.set("springs.stiffness", 20.0)
        simulation.advance(30)
        position = simulation.state().position
    expected = reference.simulate(scene.replace({"springs.stiffness": 20.0}), 30)[0]
    assert np.abs(position - expected).max() < 4 * 30 * EPSILON["float64"] * 18 * 1.5


# ---------------------------------------------------------------------- energies and frequency


def test_forces_are_the_slope_of_the_energy():
    """Central differences of the spring energy over d = 1e-6 m: their error k d^2 / 6 and rounding eps E / d are under
    1e-6 N."""
    scene = uneven(**{"grid.rows": 4, "grid.columns": 5, "gravity.enabled": False, "external.magnitude": 0.0})
    position = reference.start(scene)[0] + np.random.default_rng(1).uniform(-0.2, 0.2, (20, 2))
    force = reference.spring_forces(scene, position.reshape(4, 5, 2)).reshape(-1, 2)
    slope, still = np.zeros_like(force), np.zeros_like(force)
    for place in np.ndindex(*force.shape):
        around = []
        for side in (1e-6, -1e-6):
            moved = position.copy()
            moved[place] += side
            around.append(energies(scene, moved, still)["spring"])
        slope[place] = (around[0] - around[1]) / 2e-6
    assert np.abs(force + slope).max() < 1e-6


def test_stiffnesses_follow_the_lower_end():
    scene = uneven(**{"grid.rows": 4, "grid.columns": 5})
    across, down = spring_stiffness(scene)
    assert across.shape == (1, 4) and down.shape == (3, 1)
    assert across.ravel().tolist() == [10, 70, 10, 70] and down.ravel().tolist() == [10, 70, 10]
    net = scene_net(scene)
    assert np.array_equal(net.ends, spring_ends(4, 5))
    row, column = np.divmod(net.ends[:, 0], 5)
    odd = np.where(net.ends[:, 1] == net.ends[:, 0] + 1, column, row) % 2 == 1
    assert np.array_equal(net.stiffness, np.where(odd, 70.0, 10.0))


@pytest.mark.parametrize("pinned", ["none", "top", "edges", "top-corners"])
@pytest.mark.parametrize("shape", [(1, 2), (2, 1), (1, 3), (3, 5), (9, 12)])
@pytest.mark.parametrize("ratio", [1.5, 100.0, 1e6])
def test_frequencies_are_those_of_the_matrix(shape, pinned, ratio):
    """Estimate from below, to its tolerance, both bounds from above, the tight one and that of any grid."""
    springs = {"stiffness": 10.0, "stiffness_ratio": ratio}
    scene = Scene({"grid": {"rows": shape[0], "columns": shape[1], "pinned": pinned}, "springs": springs})
    net = scene_net(scene)
    matrix = np.stack([net.apply(row) for row in np.eye(len(net.inverse_mass))])
    exact = sqrt(max(0.0, float(np.linalg.eigvalsh(matrix)[-1])))
    found = scene_frequency(scene)
    assert found.estimate == pytest.approx(exact, rel=1e-6, abs=1e-6)
    assert exact * (1 - 1e-12) <= found.upper * (1 + 1e-9) <= frequency_bound(scene) * (1 + 2e-9)


def test_large_alternating_grids_are_bounded():
    """Whatever the pins: a mass has one spring of each stiffness along each direction, so w^2 <= 4 (k + r k) / m, which a
    grid that is iterated on is just under."""
    scene = uneven(**{"grid.rows": 512, "grid.columns": 512, "grid.pinned": "top"})
    assert scene.grid.particle_count > MAX_MASSES
    found = scene_frequency(scene)
    assert found.how == "bounded" and found.upper == pytest.approx(sqrt(4 * 80 / 0.01), rel=1e-12)
    smaller = largest_frequency(scene_net(scene.replace({"grid.rows": 40, "grid.columns": 40})))
    assert 0.98 * found.upper < smaller.estimate < found.upper


@pytest.mark.parametrize("name", ["lab", "semi-implicit-euler", "velocity-verlet", "rk4"])
@pytest.mark.parametrize("side", [0.995, 1.005])
def test_the_net_s_own_limit_is_the_edge(name, side):
    """Without rest lengths the chain is linear: at 0.995 of the limit of its largest frequency the fastest mode decays, at
    1.005 it grows, over so many steps that the step's spectral radius makes a factor of 1000 of it (beside the limit the two
    parts of a step's motion are almost parallel, which makes some tens of growth by itself)."""
    chain = load_scene("hard/b1").replace(
        {
            "springs.rest_length": 0.0,
            "springs.stiffness_ratio": 50.0,
            "gravity.enabled": False,
            "method.integrator": name,
        }
    )
    found, gamma = scene_frequency(chain), damping_rate(chain)
    dt = side * INTEGRATORS[name].limit(found.estimate, gamma)
    scene = chain.replace({"method.dt": dt})
    radius = float(np.abs(np.linalg.eigvals(amplification_matrix(name, dt, found.estimate, gamma))).max())
    steps = int(np.ceil(np.log(1000) / abs(np.log(radius))))
    mode = found.mode
    position, velocity = np.stack([mode, -mode], axis=1), np.zeros((21, 2))
    position, velocity = reference.simulate(scene, steps, position, velocity)
    part = mode / (mode @ mode)
    size = float(np.sqrt((part @ position) ** 2 + (part @ velocity / found.estimate) ** 2).max())
    assert size < 1 if side < 1 else size > 1


# ---------------------------------------------------------------------- choosers


def test_the_gpu_s_chooser_takes_a_kernel_that_can(monkeypatch):
    pytest.importorskip("numba.cuda", reason="needs numba-cuda")
    from softlab.gpu_backend.mass_spring.grid import choice

    monkeypatch.setattr(choice, "can_capture", lambda: True)
    kernel, tile, why = choice.default_kernel(uneven(), np.float32, choice.MEASURED_LIMITS)
    assert (kernel, tile) == ("graph", None) and "alternate" in why
    equal = uneven().replace({"springs.stiffness_ratio": 1.0})
    assert choice.default_kernel(equal, np.float32, choice.MEASURED_LIMITS)[0] == "one-block"


def test_the_door_says_it():
    with pytest.raises(UnstableTimeStep, match=r"stiffness ratio 1e\+06: dt is 316\.2 times"):
        open_simulation("hard/b1")
