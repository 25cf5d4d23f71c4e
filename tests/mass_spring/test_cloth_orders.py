"""Orders and limits of the integrators on a cloth, and what judges a run of one: reference, growth, frequency."""

from __future__ import annotations

from itertools import pairwise
from math import log2, sqrt

import numpy as np
import pytest
from cloth_solve import accelerations, cloth, each_solver, solve

from softlab.bench.experiments.accuracy.judge import judge_run
from softlab.bench.experiments.growth import growth_along, measure_growth
from softlab.bench.reference import cache
from softlab.bench.reference import mass_spring as reference
from softlab.model.base.errors import Diverged
from softlab.model.core.build import build
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import frequency_bound
from softlab.model.core.simulation import State
from softlab.model.core.stability.cloth_bounds import cloth_eigenvalue
from softlab.model.core.stability.limit import frequency_lines, scene_frequency, scene_net
from softlab.model.core.stability.springs import spring_ends
from softlab.model.scene.scene import Scene, load_scene

SPRINGS = {"structural": {"stiffness": 20.0}, "shear": {"stiffness": 10.0}, "bending": {"stiffness": 2.0}}
DAMPED = SPRINGS | {"structural": {"stiffness": 20.0, "damping": 0.02}, "shear": {"stiffness": 10.0, "damping": 0.01}}
NET, DAMPED_NET = ({kind: parts[kind] for kind in ("structural", "shear")} for parts in (SPRINGS, DAMPED))
WIND = {"velocity": (1.0, 0.5, 6.0), "gust": 0.3, "gust_time": 0.25}


def hung(**parts) -> Scene:
    return cloth(4, 4, sheet={"pinned": "top-corners"}, perturbation={"amplitude": 0.01}, gravity={}, **parts)


CASES = {
    "rk4": ("rk4", 4, SPRINGS | {"damping": {"coefficient": 0.01}}, 64),
    "rk4 with all": ("rk4", 4, DAMPED | {"damping": {"coefficient": 0.01}, "wind": WIND}, 64),
    "verlet": ("velocity-verlet", 2, SPRINGS, 256),
    "verlet damped": ("velocity-verlet", 2, SPRINGS | {"damping": {"coefficient": 0.02}}, 256),
    "verlet with dampers along springs": ("velocity-verlet", 1, DAMPED, 2048),
    "verlet in wind": ("velocity-verlet", 1, SPRINGS | {"wind": WIND}, 512),
    "semi": ("semi-implicit-euler", 1, DAMPED | {"damping": {"coefficient": 0.01}, "wind": WIND}, 512),
}


@each_solver
@pytest.mark.parametrize("case", CASES)
def test_orders(solver, case):
    """Observed from three solutions at h, h/2, h/4 (T = 1/4 s): log2 of the ratio of their differences, within 0.1."""
    integrator, order, parts, steps = CASES[case]
    ends = []
    for halving in range(3):
        count = steps * 2**halving
        scene = hung(**parts, method={"integrator": integrator, "dt": 0.25 / count})
        ends.append(solve(solver, scene, count)[0])
    differences = [np.linalg.norm(b - a) for a, b in pairwise(ends)]
    assert log2(differences[0] / differences[1]) == pytest.approx(order, abs=0.1)


def test_converged_reference_of_a_cloth_in_wind(tmp_path):
    """Its estimate is met by a solution ten times finer; it is kept; and a run at small steps is judged by it."""
    scene = hung(**DAMPED, damping={"coefficient": 0.01}, wind=WIND, method={"integrator": "rk4", "dt": 0.25 / 512})
    rough = cache.cached_reference(scene, 0.25, tmp_path, tolerance=1e-6)
    fine = cache.cached_reference(scene, 0.25, tmp_path, tolerance=1e-8)
    assert np.linalg.norm(rough.position - fine.position, axis=1).max() < rough.estimate < 1e-6 * 0.125
    assert np.array_equal(cache.cached_reference(scene, 0.25, tmp_path, tolerance=1e-6).position, rough.position)
    body = build(scene)
    semi = scene.replace({"method.integrator": "semi-implicit-euler"})
    end = State(*reference.simulate(semi, 512), body.inverse_mass, 0.25, 512)
    error, reason = judge_run(semi, end, None)
    exact = np.linalg.norm((end.position - fine.position)[body.inverse_mass > 0], axis=1)
    assert reason is None and error == pytest.approx(np.sqrt(np.mean(exact**2)) / 0.125, rel=1e-3)


def test_contacts_do_not_pass_for_converged():
    """A cloth that has fallen onto a ball: the estimate is the whole difference, far above the tolerance, and said so."""
    ball = {"center": (0.2, -0.3, 0.2), "radius": 0.2}
    scene = cloth(5, 5, sheet={"placement": "flat"}, gravity={}, **SPRINGS, sphere=ball)
    position, _, estimate = reference.converged(scene, 0.3, tolerance=1e-6, per_radian=0.5)  # 24 steps, to 192
    finer = reference.simulate(scene.replace({"method.integrator": "rk4", "method.dt": 0.3 / 750}), 750)[0]
    assert 1e-6 * 0.125 < estimate < 0.05 * 0.125
    assert np.linalg.norm(position - finer, axis=1).max() < 2 * estimate  # both are off by about one of them


def test_growth_of_a_disturbance_in_space():
    """A free cloth without springs flies straight: twins stay as far apart as they began. Along z too."""
    scene = cloth(4, 5)
    assert measure_growth(scene, 1.0).factors == pytest.approx(1, abs=1e-6)  # of 1e-10 m, against coordinates of 0.5 m
    began = []
    growth_along(scene, 1.0, lambda position, count: began.append(position) or [position] * 24)
    assert np.abs(began[1] - began[0]).max(axis=0).min() > 5e-11


@pytest.mark.parametrize("kind", ["structural", "shear", "bending"])
@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (2, 2), (4, 6)])
def test_springs_join_masses_at_their_rest_length(kind, shape):
    """Every pair of masses as far apart as the kind's springs are long, and no other."""
    scene = cloth(*shape)
    position = reference.start(scene)[0]
    length = 0.125 * {"structural": 1, "shear": sqrt(2), "bending": 2}[kind]
    apart = np.linalg.norm(position[:, None] - position[None], axis=2)
    expected = {(i, j) for i, j in zip(*np.nonzero(np.isclose(apart, length)), strict=True) if i < j}
    if kind == "bending":  # a knight's neighbours aside, two masses lie 2 apart along a row or a column alone
        expected = {pair for pair in expected if len({pair[0] // shape[1], pair[1] // shape[1]}) in (1, 2)}
    assert {tuple(sorted(pair)) for pair in spring_ends(*shape, kind).tolist()} == expected


@pytest.mark.parametrize(("stiffness", "value"), [((1, 1, 1), 49 / 3), ((1, 0.5, 0.1), 8.4), ((1, 0, 0), 8)])
def test_the_endless_cloths_eigenvalue(stiffness, value):
    """The any-state values printed in A1, and over the whole square of phases none is larger."""
    assert cloth_eigenvalue(*stiffness) == pytest.approx(value, rel=1e-14)
    x, y = np.meshgrid(np.cos(np.linspace(0, np.pi, 400)), np.cos(np.linspace(0, np.pi, 400)))
    s, h, c = stiffness
    waves = 2 * s * (2 - x - y) + 4 * h * (1 - x * y) + 4 * c * (2 - x * x - y * y)
    assert value * (1 - 1e-4) < waves.max() <= value * (1 + 1e-14)


@pytest.mark.parametrize("pinned", ["none", "top", "top-corners", "edges"])
@pytest.mark.parametrize("shape", [(5, 6), (1, 7), (9, 9)])
def test_frequency_of_a_cloths_net(shape, pinned):
    """The iterated estimate is the dense matrix's largest eigenvalue; the bounds lie above, one below the other."""
    scene = cloth(*shape, sheet={"pinned": pinned}, **SPRINGS)
    net = scene_net(scene)
    exact = sqrt(max(0.0, np.linalg.eigvalsh(np.stack([net.apply(row) for row in np.eye(len(net.inverse_mass))]))[-1]))
    found = scene_frequency(scene)
    assert found.estimate == pytest.approx(exact, rel=1e-6)
    assert exact <= found.upper * (1 + 1e-9) and found.upper <= frequency_bound(scene) * (1 + 1e-12)


def test_what_the_plan_says_of_a_cloth():
    """Less than the bound on any cloth, and the step size that follows from it; a large one has that bound."""
    scene = load_scene("cloth-hanging")
    (line,) = frequency_lines(scene)
    assert "345.953 1/s of this net" in line and "346.41 1/s of any cloth" in line
    large = scene_frequency(scene.replace({"cloth.rows": 512, "cloth.columns": 512}))
    assert large.how == "bounded" and large.upper == pytest.approx(sqrt(1200 / 0.01))  # 4 s + 8 h, phases pi and 0
    assert frequency_lines(cloth(3, 3)) == []


def stretched(factor: float, share: float, integrator: str, **parts) -> tuple[Scene, np.ndarray]:
    """A cloth held at all edges and stretched so far that its net is nearly linear, at a share of its net's limit. Without
    bending springs, of which a mass beside an edge has one alone, this is an equilibrium."""
    scene = cloth(6, 6, sheet={"pinned": "edges"}, method={"integrator": integrator}, **parts)
    limit = stability_limit(scene, scene_frequency(scene).upper)
    position = factor * reference.start(scene)[0]
    inner = ~reference.pinned_mask(scene).ravel()
    position[inner] += 1e-6 * np.random.default_rng(0).uniform(-1, 1, (inner.sum(), 3))
    return scene.replace({"method.dt": share * limit}), position


@each_solver
@pytest.mark.parametrize("parts", [NET, DAMPED_NET], ids=["springs", "dampers along them"])
@pytest.mark.parametrize("integrator", ["semi-implicit-euler", "velocity-verlet", "rk4"])
def test_holds_just_under_its_limit(solver, integrator, parts):
    """At 0.995 of its net's limit a disturbance of 1e-6 m is still under 1e-4 m after 10^4 steps (2000 of rk4)."""
    scene, position = stretched(30.0, 0.995, integrator, **parts)
    later, _ = solve(solver, scene, 2000 if integrator == "rk4" else 10_000, position)
    assert np.abs(later - 30.0 * reference.start(scene)[0]).max() < 1e-4


@each_solver
@pytest.mark.parametrize("integrator", ["semi-implicit-euler", "velocity-verlet", "rk4"])
def test_fails_just_over_it(solver, integrator):
    """Stretched 30 times the net has at least 1 - 1/30 of its stiffness: at 1.05 times the limit it leaves the sheet."""
    scene, position = stretched(30.0, 1.05, integrator, **NET)
    try:
        later, _ = solve(solver, scene, 400, position)
    except Diverged:  # a backend looks, the reference does not
        return
    assert not np.abs(later - 30.0 * reference.start(scene)[0]).max() < 10


@each_solver
def test_wind_pushes_the_same_whichever_way_the_normals_point(solver):
    """A cloth seen from behind (its columns in reverse, so that its normals turn) feels the mirrored cells' force."""
    scene = cloth(2, 2, wind={"velocity": (0.0, 0.0, 3.0)})
    position = reference.start(scene)[0]
    there = accelerations(solver, scene, position).sum(axis=0)
    back = accelerations(solver, scene, position[[1, 0, 3, 2]]).sum(axis=0)
    assert there == pytest.approx(back, abs=1e-12) and there[2] > 1
