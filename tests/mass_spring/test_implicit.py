"""Implicit Euler on the cloth against closed forms, the NumPy reference, RK4 and XPBD; and its bits for any thread count."""

from __future__ import annotations

from math import atan, hypot, sqrt
from typing import Any

import numpy as np
import pytest
from cloth_scenes import POKE, cloth_scene
from cloth_solve import cloth

from softlab.app.driver import open_simulation
from softlab.bench.reference import mass_spring
from softlab.model.base.variant import plain_formulas
from softlab.model.core.build import build
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import IMPLICIT, amplification_matrix
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

EXACT = {"precision": "float64", "math": "exact"}
STIFF = {
    "structural": {"stiffness": 1e4}, "shear": {"stiffness": 1e4}, "bending": {"stiffness": 1e3}, "gravity": {},
    "sheet": {"pinned": "top", "spacing": 0.1, "mass": 0.01},
}  # fmt: skip


def method(dt: float, name: str = "implicit-euler") -> dict[str, Any]:
    return {"method": {"integrator": name, "dt": dt}}


def stepped(scene: Scene, steps: int, start: tuple | None = None, **options: Any) -> tuple[State, np.ndarray]:
    """(state, (steps, matrices, iterations, halvings)) on the CPU."""
    initial = None if start is None else State(*start, build(scene).inverse_mass, 0.0, 0)
    with open_simulation(scene, "cpu", initial=initial, **(EXACT | {"threads": 2} | options)) as simulation:
        simulation.advance(steps)
        return simulation.state(), simulation.implicit.done.copy()


def oscillator(coefficient: float, dt: float) -> Scene:
    parts: dict[str, Any] = {
        "structural": {"stiffness": 10.0},
        "sheet": {"pinned": "top", "spacing": 1.0, "mass": 0.01},
    }
    return cloth(2, 1, **parts, damping={"coefficient": coefficient}, **method(dt))


@pytest.mark.parametrize("name", IMPLICIT)
@pytest.mark.parametrize("coefficient", [0.0, 0.03])
def test_a_spring_follows_the_amplification_matrix(coefficient: float, name: str) -> None:
    """Along its spring the mass is the linear oscillator w^2 = k/m = 1000, extension 0.1 m: of order |lambda|^n to the part
    of the residual that is left, 1e-6 of a speed of 3 m/s at most, each of 20 steps; undamped |lambda| = 0.953463, the phase
    atan(h w) = 0.30627737 a step."""
    scene = oscillator(coefficient, 0.01).replace({"method.integrator": name})
    position, velocity = build(scene).position.copy(), np.zeros((2, 3))
    position[1, 1] -= 0.1
    state, _ = stepped(scene, 20, (position, velocity))
    matrix = amplification_matrix(name, 0.01, sqrt(1000.0), coefficient / 0.01)
    x, v = np.linalg.matrix_power(matrix, 20) @ [-0.1, 0.0]
    assert state.position[1] == pytest.approx([0.0, -1.0 + x, 0.0], abs=20 * 1e-6 * 3 * 0.01)
    assert state.velocity[1] == pytest.approx([0.0, v, 0.0], abs=20 * 1e-6 * 3)
    if coefficient == 0:
        (value, _) = np.linalg.eigvals(matrix)
        assert abs(value) == pytest.approx(0.953463, abs=5e-7)
        assert abs(np.angle(value)) / 0.01 == pytest.approx(30.627737, abs=5e-7) == atan(0.01 * sqrt(1000.0)) / 0.01


def test_no_step_size_is_too_large() -> None:
    """|lambda| of the linear test equation, at the lab's fastest mode 0.739221 (its eigenvalues' larger one), and for every
    w and gamma at most 1; so a scene is never refused."""
    assert np.abs(np.linalg.eigvals(amplification_matrix("implicit-euler", 0.01, sqrt(8000.0), 3.0))).max() == (
        pytest.approx(0.739221, abs=5e-7)
    )
    for w in (0.0, 1.0, 1e3, 1e6):
        for gamma in (0.0, 3.0, 1e4):
            values = np.linalg.eigvals(amplification_matrix("implicit-euler", 1.0, w, gamma))
            assert np.abs(values).max() <= 1 + 1e-12
    assert stability_limit(cloth(4, 4, **STIFF, **method(1e3))) == float("inf")


@pytest.mark.parametrize(
    "name,integrator,steps",
    [
        ("springs", "implicit-euler", 10),
        ("everything moving", "implicit-euler", 3),
        ("springs", "implicit-euler-linear", 5),
    ],
)
def test_it_follows_the_reference(name: str, integrator: str, steps: int) -> None:
    """Each solves a step to its tolerance of the first residual |v + dt a| (1e-8 of it; linearised, 1e-6), the reference to
    rounding; no eigenvalue of the matrix is below 1, so velocities differ by that much a step, and what they differ by
    dies out. The first residual is of the masses' speed and of what dampers and stretched springs would give in a step."""
    scene = cloth_scene(name, integrator)
    with open_simulation(scene, "cpu", threads=2, live=("poke",), **EXACT) as simulation:
        simulation.poke(*POKE)
        simulation.advance(steps)
        state = simulation.state()
    position, velocity = mass_spring.simulate(scene, steps, poke=POKE)
    speed = np.linalg.norm(velocity) + scene.method.dt * 1e3 * sqrt(len(position))
    bound = steps * speed * (1e-6 if integrator == "implicit-euler-linear" else 1e-8)
    assert np.abs(position - build(scene).position).max() > 1e3 * bound * scene.method.dt
    assert np.abs(state.velocity - velocity).max() < bound
    assert np.abs(state.position - position).max() < bound * scene.method.dt * steps


@pytest.mark.parametrize("name", IMPLICIT)
def test_energy_falls_at_a_hundred_times_the_explicit_limit(name: str) -> None:
    """A hanging sheet, undamped, its masses moved by a tenth of a spacing: 400 steps at 100 times semi-implicit Euler's limit
    never gain energy (to 1e-6 of what there was), and end at rest with each row carrying those below it."""
    scene = cloth(8, 6, **STIFF, perturbation={"amplitude": 0.01}, **method(0.1, name))
    limit = stability_limit(scene.replace({"method.integrator": "semi-implicit-euler"}))
    scene = scene.replace({"method.dt": 100 * limit})
    energies = []
    with open_simulation(scene, "cpu", threads=1, **EXACT) as simulation:
        for _ in range(80):
            energies.append(simulation.energies()["total"])
            simulation.advance(5)
        state = simulation.state()
    assert np.diff(energies).max() < 1e-6 * (energies[0] - energies[-1])
    assert np.abs(state.velocity).max() < 1e-4
    forces = mass_spring.simulate(scene.replace({"method.integrator": "semi-implicit-euler", "method.dt": 1e-6}), 1,
                                  state.position, np.zeros_like(state.velocity))[1] / 1e-6  # fmt: skip
    assert np.abs(forces).max() < 1e-3 * 9.81


def test_float32_stops_at_rounding_and_follows_float64() -> None:
    """60 steps of 10 ms, k / m = 1e6: matrices a step stay few though 1e-8 is out of reach. A step is off by what rounding
    leaves of a residual (2^-24 of dt times what springs of 0.1 m and more pull: 1e4 m/s), times dt, and by 2^-24 of the
    coordinates. Far from the origin, too: in p + dt u spacings would be known to 6e-6 m, and pulls to 6 m/s^2 only."""
    for origin, coordinate in (([0.0, 0.0, 0.0], 1.5), ([100.0, 50.0, 0.0], 100.0)):
        bound = 60 * 2**-24 * (0.01 * 1.05e4 + coordinate)
        sheet = STIFF["sheet"] | {"origin": origin, "placement": "flat"}
        scene = cloth(12, 12, **(STIFF | {"sheet": sheet}), perturbation={"amplitude": 0.005}, **method(0.01))
        double, _ = stepped(scene, 60)
        single, done = stepped(scene, 60, precision="float32")
        assert done[0] <= done[1] < 20 * done[0]
        assert np.abs(double.position - build(scene).position).max() > 0.3
        assert np.abs(single.position - double.position).max() < bound


def test_sums_over_masses_are_taken_in_their_order() -> None:
    """By loops of Python: LANES running sums of a segment, TREE of all segments, each added up in halves."""
    from softlab.cpu_backend.core.compile import Compiler
    from softlab.cpu_backend.mass_spring.cloth import sums
    from softlab.model.mass_spring.implicit_parameters import LANES, SEGMENT, TREE

    compiler = Compiler("test_sums", "exact")
    variant = compiler.variant_of(np.float32)
    segment_sums, total = variant(sums.segment_sums), variant(sums.total)

    @compiler.kernel
    def run(columns, vectors, lanes, parts, tree):
        segment_sums(columns, *vectors, lanes, parts)
        return total(parts, parts.size, tree)

    def halved(running: list[np.float32]) -> np.float32:
        while len(running) > 1:
            half = len(running) // 2
            running = [running[k] + running[k + half] for k in range(half)]
        return running[0]

    def running(values: list[np.float32], count: int) -> np.float32:
        slots = [np.float32(0)] * count
        for k, value in enumerate(values):
            slots[k % count] += value
        return halved(slots)

    for columns in (1, 31, 64, 257, 700):
        vectors = tuple(np.random.default_rng(columns).normal(size=(6, columns)).astype(np.float32))
        parts = np.zeros(-(-columns // SEGMENT), np.float32)
        found = run(columns, vectors, np.zeros(LANES, np.float32), parts, np.zeros(TREE, np.float32))
        ax, ay, az, bx, by, bz = vectors
        products = [(ax[k] * bx[k] + ay[k] * by[k]) + az[k] * bz[k] for k in range(columns)]
        expected = [running(products[n : n + SEGMENT], LANES) for n in range(0, columns, SEGMENT)]
        assert parts.tolist() == expected
        assert found == running(expected, TREE)


def test_the_matrix_of_a_stretched_spring_is_the_forces_derivative() -> None:
    """And of a pressed one that with no stiffness across: a product along n is the same, one across is 0."""
    from softlab.model.formulas import implicit as formulas

    product = plain_formulas(formulas, np.float64).product_3d
    d = np.array([0.3, -0.2, 0.6])  # 0.7 m
    n, across = d / 0.7, np.cross(d, [1.0, 2.0, 0.5])
    for rest, turning in ((0.5, 1 - 0.5 / 0.7), (0.9, 0.0)):
        for w, factor in ((n, 10.0), (across, 10.0 * turning)):
            assert np.allclose(product(*d, *w, 10.0, 10.0 * rest, 0.0), factor * w, rtol=1e-14, atol=1e-15)
    assert np.allclose(product(*d, *n, 0.0, 0.0, 2.0), 2.0 * n) and not any(
        product(0.0, 0.0, 0.0, 0, 0, 0, 1.0, 1.0, 1.0)
    )
    assert hypot(*product(*d, *across, 0.0, 0.0, 2.0)) < 1e-14
