"""The judge of position-based tetrahedra: its rows, where it comes to rest, and what more sweeps bring.

One sweep a substep sags too far, by (substep)^2 E; with many sweeps and kept multipliers the scalar row |F - R| ends 5 % off
the exact step, since its direction turns from sweep to sweep and old multipliers stay along old ones. F - R as one system a
tetrahedron ends at the exact step.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from bar_mesh import Bar, bar

from softlab.bench.reference import elastic_materials as materials
from softlab.bench.reference import finite_elements as fem
from softlab.bench.reference import tetrahedra as rows
from softlab.bench.reference.finite_elements_newton import implicit_euler, nonlinear_static
from softlab.bench.reference.tetrahedra import Method

DENSITY, FRAME = 1000.0, 1 / 60
ONE = np.array([[0.0, 0.0, 0.0], [0.3, 0.02, 0.0], [0.05, 0.25, 0.01], [0.1, 0.08, 0.2]])
WAYS = (*rows.SCHEMES, "blocks")


def one(material: str) -> fem.Body:
    """A tetrahedron of 2.45 litres."""
    return fem.Body.of(ONE, np.array([[0, 1, 2, 3]]), material, 1e5, 0.3)


def inverse_masses(made: Bar) -> np.ndarray:
    return np.where(made.clamped, 0, 1 / fem.lumped_mass(made.position, made.tetrahedra, DENSITY))


@pytest.mark.parametrize("material", ("corotated", "fixed-corotated"))
def test_rows_add_up_to_the_material(material: str) -> None:
    """C^2 / (2 compliance) of both rows is V Psi; dC/dF by differences."""
    body, first = one(material), np.array([0])
    here = ONE @ np.random.default_rng(1).normal(size=(3, 3)) + 0.1

    def values(position: np.ndarray, kind: int) -> tuple[np.ndarray, ...]:
        return rows.row(body, kind, first, body.deformation(position))

    stored = [sum(float((v**2 / (2 * a))[0]) for v, _, a in (values(p, 0), values(p, 1))) for p in (here, ONE)]
    assert stored[0] - stored[1] == pytest.approx(body.energy(here), rel=1e-12)
    for kind in (rows.SHAPE, rows.VOLUME):
        _, slope, _ = values(here, kind)
        for vertex, axis in np.ndindex(4, 3):
            shift = np.zeros((4, 3))
            shift[vertex, axis] = 1e-6
            expected = (values(here + shift, kind)[0] - values(here - shift, kind)[0])[0] / 2e-6
            assert slope[0][axis] @ body.gradient[0, vertex] == pytest.approx(expected, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("material", materials.MATERIALS)
@pytest.mark.parametrize("way", WAYS)
def test_a_projection_keeps_momenta(way: str, material: str) -> None:
    """The middle of mass to rounding; by rows (not by blocks) also the angular momentum, one projection about where it is."""
    body, weight = one(material), np.array([1.0, 2.0, 0.5, 3.0])
    here = ONE @ np.diag([1.2, 0.9, 1.1]) + 0.3
    moved = rows.substep(body, here, np.zeros((4, 3)), weight, 0.01, Method([np.array([0])], scheme=way))[0]
    impulse = (moved - here) / weight[:, None]
    assert np.abs(impulse).max() > 1e-4
    np.testing.assert_allclose(impulse.sum(axis=0), 0, atol=1e-12)
    if way == "together" and material != "neo-hookean":  # the others move in between
        np.testing.assert_allclose(np.cross(here, impulse).sum(axis=0), 0, atol=1e-12)


@pytest.mark.parametrize("way", WAYS)
def test_nothing_happens_at_rest_and_pins_hold(way: str) -> None:
    """A body at rest, turned, stays to rounding (|F - R| has no direction there); flat and inverted ones stay finite."""
    made = bar(1)
    body = fem.Body.of(made.position, made.tetrahedra, "fixed-corotated", 1e6, 0.3)
    weight, still = inverse_masses(made), np.zeros_like(made.position)
    turn = materials.rotation(np.random.default_rng(2).normal(size=(3, 3)))
    turned = made.position @ turn.T
    method = Method(made.colours, 2, scheme=way)
    p, v = rows.simulate(body, turned, still, weight, FRAME, 2, 3, method)
    np.testing.assert_allclose(p, turned, rtol=0, atol=1e-8)
    flat = made.position * [1, -0.5, 0]
    method = replace(method, gravity=(0, -9.81, 0), damping_time=0.01)
    p, v = rows.simulate(body, flat, still, weight, FRAME, 2, 3, method)
    assert np.isfinite(p).all() and np.isfinite(v).all()
    np.testing.assert_array_equal(p[made.clamped], flat[made.clamped])
    assert np.abs(p - flat).max() > 0.01


@pytest.mark.parametrize("material", ("corotated", "fixed-corotated"))
def test_sweeps_approach_the_exact_step_by_blocks_alone(material: str) -> None:
    """Multipliers kept: of how far a step of implicit Euler goes beyond the prediction, blocks leave 1e-5, rows some per
    cent, however many sweeps. The volume's row turns a little, too: that is the 1e-5."""
    made = bar(1, 5, length=0.4)
    body = fem.Body.of(made.position, made.tetrahedra, material, 1e6, 0.3)
    mass = fem.lumped_mass(made.position, made.tetrahedra, DENSITY)
    v = np.zeros_like(made.position)
    v[:, 1] = -(made.position[:, 0] ** 2)
    h, gravity = 1 / 240, (0.0, -0.1, 0.0)
    exact, _ = implicit_euler(body, made.position, v, mass, made.clamped, h, gravity)
    far = np.abs(exact - made.position - h * v).max()
    left = {}
    for way, sweeps in (("rows", 50), ("rows", 100), ("blocks", 10), ("blocks", 100)):
        method = Method(made.colours, sweeps, gravity, scheme=way)
        p, _ = rows.simulate(body, made.position, v, inverse_masses(made), h, 1, 1, method)
        left[way, sweeps] = np.abs(p - exact).max() / far
    assert left["blocks", 100] < 2e-5 < left["blocks", 10]
    assert left["rows", 100] == pytest.approx(left["rows", 50], rel=0.01) and left["rows", 100] > 5e-3


@pytest.mark.parametrize("way", ("rows", "blocks"))
def test_damping_by_a_time(way: str) -> None:
    """In proportion to stiffness: a vibration of angular frequency w dies as exp(-tau w^2 t / 2), beside what the step takes
    (w^2 h t / 2). One tetrahedron, its lowest mode, 2 % of what is expected."""
    body, free = one("fixed-corotated"), np.zeros(4, dtype=bool)
    mass = fem.lumped_mass(ONE, body.tetrahedra, DENSITY)
    frequency, shapes = fem.mode_shapes(ONE, body.tetrahedra, 1e5, 0.3, DENSITY, free, 7)
    w, shape = 2 * np.pi * frequency[6], shapes[6] / np.abs(shapes[6]).max()
    h = 1 / (400 * frequency[6])
    left = []
    for tau in (0.0, 0.02 / w):
        p, v = ONE + 1e-4 * shape, np.zeros_like(ONE)
        method = Method([np.array([0])], damping_time=tau, scheme=way)
        p, v = rows.simulate(body, p, v, 1 / mass, 800 * h, 800, 1, method)
        energy = body.energy(p) + float((mass[:, None] * v**2).sum()) / 2
        left.append(energy)
    assert np.log(left[0] / left[1]) == pytest.approx(0.02 / w * w**2 * 800 * h, rel=0.02)


@cache
def exact_sag(young: float, poisson: float) -> tuple[Bar, np.ndarray, tuple[float, float, float]]:
    made, gravity = bar(2), (0.0, -0.1 * young / 1e6, 0.0)
    body = fem.Body.of(made.position, made.tetrahedra, "fixed-corotated", young, poisson)
    exact = nonlinear_static(body, made.clamped, gravity=gravity, density=DENSITY)
    return made, exact, gravity


def too_far(young: float, substeps: int, iterations: int = 1, way: str = "rows", poisson: float = 0.3) -> float:
    """The tip's sag at rest over that of the exact answer on the same mesh, 400 tetrahedra under their own weight."""
    made, exact, gravity = exact_sag(young, poisson)
    body = fem.Body.of(made.position, made.tetrahedra, "fixed-corotated", young, poisson)
    method = Method(made.colours, iterations, gravity, scheme=way)
    found = rows.at_rest(body, exact, inverse_masses(made), FRAME / substeps, method)
    return float((found - made.position)[made.tip, 1].mean() / (exact - made.position)[made.tip, 1].mean())


# E [Pa], substeps, sweeps -> found by another program, and here; the colours' order moves 16 substeps by 3 %, 4 by 20 %
TOO_FAR = [
    (1e6, 64, 1, 1.018, 1.0185), (1e6, 30, 1, 1.089, 1.0902), (1e6, 4, 1, 6.64, 6.722), (1e6, 16, 1, 1.352, 1.3547),
    (1e6, 128, 1, 1.004, 1.0045), (1e5, 4, 1, 1.564, 1.5884), (1e5, 30, 1, 1.007, 1.0083), (1e7, 30, 1, 2.065, 2.0708),
    (1e7, 4, 1, 45.1, 45.455), (1e6, 4, 8, 1.48, 1.4948),
]  # fmt: skip


@pytest.mark.parametrize(("young", "substeps", "sweeps", "elsewhere", "here"), TOO_FAR)
def test_few_sweeps_sag_too_far(young: float, substeps: int, sweeps: int, elsewhere: float, here: float) -> None:
    """The finding that this family is about, within 2 % of what was found elsewhere, and to the digits found here."""
    found = too_far(young, substeps, sweeps)
    assert found == pytest.approx(elsewhere, rel=0.02)
    assert found == pytest.approx(here, rel=1e-4)


@pytest.mark.parametrize(("substeps", "sweeps", "here"), [(30, 1, 1.08279), (4, 1, 5.36004), (4, 8, 1.24346)])
def test_blocks_sag_less(substeps: int, sweeps: int, here: float) -> None:
    """The shape in one system: better with one sweep, and with eight half of what rows are too far (1.4948)."""
    assert too_far(1e6, substeps, sweeps, "blocks") == pytest.approx(here, rel=1e-4)


def test_damped_rows_sag_further() -> None:
    """With one sweep eq. 26's damper counts what gravity moves a vertex by before its rows are met: 16 % beyond the 9 % at
    1 ms. It ought to vanish at rest; what damps velocities after the sweep does."""
    made, exact, gravity = exact_sag(1e6, 0.3)
    body = fem.Body.of(made.position, made.tetrahedra, "fixed-corotated", 1e6, 0.3)
    method = Method(made.colours, 1, gravity, damping_time=1e-3)
    found = rows.at_rest(body, exact, inverse_masses(made), FRAME / 30, method)
    sag, expected = ((p - made.position)[made.tip, 1].mean() for p in (found, exact))
    assert sag / expected == pytest.approx(1.2477, rel=1e-3)


@pytest.mark.parametrize("way", ("rows", "volume-first"))
def test_neo_hookean_rows_stay_without_a_load(way: str) -> None:
    """Shape and volume each rest by themselves, so that in any order a bar of E 1e6 stays where it is, to rounding: one of
    |F| and one of det F - alpha in turn made it lose a per cent of its volume within a quarter of a second."""
    made = bar(1, 5, length=0.4)
    body = fem.Body.of(made.position, made.tetrahedra, "neo-hookean", 1e6, 0.3)
    still = np.zeros_like(made.position)
    p, _ = rows.simulate(
        body, made.position, still, inverse_masses(made), FRAME, 1, 15, Method(made.colours, scheme=way)
    )
    np.testing.assert_allclose(p, made.position, rtol=0, atol=1e-14)


@pytest.mark.parametrize(("poisson", "rate"), [(0.0, 0.82), (0.3, 0.82), (0.49, 0.88)])
def test_neo_hookean_sweeps_approach_the_exact_step(poisson: float, rate: float) -> None:
    """Multipliers kept: where sweeps end is the step of implicit Euler, at strains of 3 %. Each of 60 sweeps leaves `rate` of
    what is left or less (here 0.81, 0.81 and 0.87 on average; stiff volumes couple more of them)."""
    made = bar(1, 5, length=0.2)
    body = fem.Body.of(made.position, made.tetrahedra, "neo-hookean", 1e6, poisson)
    mass = fem.lumped_mass(made.position, made.tetrahedra, DENSITY)
    v = np.zeros_like(made.position)
    v[:, 1] = -100 * made.position[:, 0] ** 2
    h, gravity = 1 / 240, (0.0, -0.1, 0.0)
    exact, _ = implicit_euler(body, made.position, v, mass, made.clamped, h, gravity)
    assert np.linalg.svd(body.deformation(exact), compute_uv=False).max() > 1.025
    far = np.abs(exact - made.position - h * v).max()
    p, _ = rows.simulate(body, made.position, v, inverse_masses(made), h, 1, 1, Method(made.colours, 60, gravity))
    assert np.abs(p - exact).max() < rate**60 * far


@pytest.mark.parametrize("iterations", [1, 2])
def test_at_rest_is_where_steps_come_to_rest(iterations: int) -> None:
    """Stepped for 4 s under drag, from the exact answer, a bar of 50 tetrahedra is where the fixed point says (1e-4)."""
    made, gravity = bar(1), (0.0, -0.1, 0.0)
    body = fem.Body.of(made.position, made.tetrahedra, "fixed-corotated", 1e6, 0.3)
    weight = inverse_masses(made)
    method = Method(made.colours, iterations, gravity)
    there = rows.at_rest(body, made.position, weight, FRAME / 4, method)
    still = np.zeros_like(there)
    p, v = rows.simulate(body, made.position, still, weight, FRAME, 4, 360, replace(method, drag=5.0))
    assert np.abs(p - there).max() < 1e-3 * np.abs(there - made.position).max() and np.abs(v).max() < 1e-3
