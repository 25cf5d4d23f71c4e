"""Position-based tetrahedra that are hundreds of times as long as high: a soup of them stays at rest.

`rows = "blocks"` held the rotation of F while it moved the corners, which made its step an oblique projection: 60 random
points at E 1e7 were 0.2 m away, at 10 m/s, after ten steps without a load."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov
from scipy.spatial import Delaunay

from softlab.app.driver import open_simulation
from softlab.bench.reference import tetrahedra as reference
from softlab.bench.reference.finite_elements import Body, lumped_mass
from softlab.model.base.variant import plain_formulas
from softlab.model.formulas.constraints import tetrahedron, tetrahedron_block
from softlab.model.scene.scene import Scene

SIDE, H = 0.3, 1 / 60
# Poisson's ratio, Young's modulus [Pa], material
MATTER = [
    (0.0, 1e3, "corotated"), (0.3, 1e5, "fixed-corotated"), (0.49, 1e6, "corotated"), (0.0, 1e7, "fixed-corotated"),
    (0.3, 1e9, "corotated"), (0.49, 1e9, "fixed-corotated"),
]  # fmt: skip
DEFAULT = (("blocks", 1, 1, "float64"), ("blocks", 4, 1, "float32"))
CASES = [
    *DEFAULT,
    *(
        pytest.param(*case, marks=pytest.mark.rest)
        for case in (
            ("blocks", 1, 3, "float32"), ("blocks", 4, 3, "float64"), ("scalar", 1, 1, "float64"),
            ("scalar", 4, 3, "float32"),
        )
    ),
]  # fmt: skip
FLAT = np.array([[0.0, 0.0, 0.0], [0.3, 0.02, 0.0], [0.05, 0.25, 0.001], [0.2, 0.18, 0.002]])
PARTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))  # of a symmetric matrix, six entries


def soup(points: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random points of a cube and their Delaunay tetrahedra of more than 20/6 ml: heights down to a millimetre."""
    position = np.random.default_rng(seed).uniform(0, SIDE, (points, 3))
    cells = Delaunay(position).simplices
    volume = np.linalg.det(position[cells[:, 1:]] - position[cells[:, :1]])
    cells[volume < 0] = cells[volume < 0][:, [0, 2, 1, 3]]
    used, cells = np.unique(cells[np.abs(volume) > 2e-5], return_inverse=True)
    return position[used], cells.reshape(-1, 4).astype(np.int32)


@pytest.mark.parametrize(("rows", "substeps", "iterations", "precision"), CASES)
def test_a_soup_of_slivers_stays_at_rest(
    tmp_path: Path, rows: str, substeps: int, iterations: int, precision: Any
) -> None:
    """To rounding: a projection leaves a corner within an ulp of its coordinate, which a substep takes for a velocity of an
    ulp a substep: n (n + 1) / 2 ulps after n, if all add up."""
    position, cells = soup(20, 0)
    np.savez(tmp_path / "soup.npz", position=position, tetrahedra=cells)
    bodies = {
        f"soup{n}": {
            "kind": "tetrahedral_body", "file": str(tmp_path / "soup.npz"), "young_modulus": young, "poisson_ratio": nu,
            "material": material, "damping": 0.0 if substeps == 1 else 1e-3,
        }
        for n, (nu, young, material) in enumerate(MATTER)
    }  # fmt: skip
    method = {"solver": "xpbd", "dt": H, "rows": rows, "substeps": substeps, "iterations": iterations}
    steps = 8 // substeps + 2
    n = steps * substeps
    ulp = SIDE * float(np.finfo(precision).eps)
    with open_simulation(
        Scene(bodies | {"method": method}), precision=precision, math="exact", threads=1
    ) as simulation:
        begin = simulation.state().position
        simulation.advance(steps)
        end = simulation.state()
    assert np.abs(end.position - begin).max() <= ulp * n * (n + 1) / 2
    assert np.abs(end.velocity).max() <= ulp * n * substeps / H


def visited(position: np.ndarray, how: str, kept: bool) -> np.ndarray:
    """(4, 3) [m]: FLAT's corners after a visit of its shape's block from `position`, at rest before."""
    body = Body.of(FLAT, np.array([[0, 1, 2, 3]]), "fixed-corotated", 1e9, 0.3)
    inverse_mass = 1 / lumped_mass(FLAT, body.tetrahedra, 1000.0)
    if how == "reference":
        place, multipliers = position.copy(), np.zeros((1, 3, 3))
        sweep = reference.Sweep(body, inverse_mass, FLAT, H, 0.0, multipliers, multipliers[..., 0, 0])
        sweep.block(np.array([0]), place)
        return place
    turned, upper = np.linalg.qr((FLAT[1:] - FLAT[0]).T)
    turned, upper = turned * np.sign(np.diag(upper)), np.sign(np.diag(upper))[:, None] * upper
    assert np.linalg.det(turned) > 0
    b = np.linalg.inv(upper)
    values = [*b[np.triu_indices(3)], 1 / (2 * body.mu[0] * body.volume[0]), 0.0, 1.0, 0.0]
    project = plain_formulas(tetrahedron, np.float64, {"blocks": True, "soft": kept, "alone": False}).project
    points, _ = project(position, FLAT, inverse_mass, values, np.zeros(10), (1 / H**2, 1 / H, 1.0))
    return np.array(points)


@pytest.mark.parametrize(("how", "kept"), [("reference", True), ("formula", True), ("formula", False)])
def test_a_visit_is_an_orthogonal_projection(how: str, kept: bool) -> None:
    """Near rest, in the norm of the masses, it lengthens nothing and is symmetric (it was 125 times as long); to 1e-5, what
    differences of 1e-8 m have of a strain of 1e-5. And its moment is of second order: half of a strain, a quarter of it."""
    root = np.sqrt(lumped_mass(FLAT, np.array([[0, 1, 2, 3]]), 1000.0))[:, None]
    slope = np.empty((12, 12))
    for n in range(12):
        way = np.zeros(12)
        way[n] = 1e-8
        step = way.reshape(4, 3) / root
        slope[:, n] = (root * (visited(FLAT + step, how, kept) - visited(FLAT - step, how, kept))).ravel() / 2e-8
    np.testing.assert_allclose(slope, slope.T, rtol=0, atol=1e-4)
    assert np.linalg.norm(slope, 2) == pytest.approx(1, abs=1e-4)

    def moment(strain: float) -> float:
        shift = np.random.default_rng(1).normal(size=(3, 3))
        begin = FLAT + strain * FLAT @ shift
        pushed = root**2 * (visited(begin, how, kept) - begin)
        return float(np.linalg.norm(np.cross(begin, pushed).sum(axis=0)) / np.linalg.norm(pushed))

    assert moment(5e-4) < 0.6 * moment(1e-3) < 1e-3 * SIDE


def matrix(h: Any) -> np.ndarray:
    """(3, 3) of six entries."""
    full = np.zeros((3, 3))
    for value, (i, j) in zip(h, PARTS, strict=False):
        full[i, j] = full[j, i] = value
    return full


@pytest.mark.parametrize("ratio", [1.0, 1e3, 1e6])
def test_the_lyapunov_equation_is_solved(ratio: float) -> None:
    """Both parts, against SciPy's solution by Schur's decomposition: to rounding times the ratio of H's eigenvalues."""
    random, formulas = np.random.default_rng(3), plain_formulas(tetrahedron_block, np.float64)
    for _ in range(20):
        axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
        h = 1e7 * (axes * [1.0, 1 / ratio, ratio ** -random.uniform()]) @ axes.T
        q = random.normal(size=(3, 3))
        six = [*(h[i, j] for i, j in PARTS), 1 / np.trace(h)]
        both, x = (q + q.T) / 2, formulas.skew(six, (q[2, 1] - q[1, 2], q[0, 2] - q[2, 0], q[1, 0] - q[0, 1]))
        found = matrix(formulas.symmetric(six, [both[i, j] for i, j in PARTS]))
        found += np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])
        right = solve_continuous_lyapunov(h / 2, q)
        np.testing.assert_allclose(found, right, rtol=0, atol=200 * ratio * np.finfo(float).eps * np.abs(right).max())


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("free", [1, 2])
def test_a_system_without_full_rank_gives_finite_numbers(free: int, real: Any) -> None:
    """Of pinned corners, whose compliance may be below rounding: what moves goes where it should, nothing is infinite."""
    random, formulas = np.random.default_rng(5), plain_formulas(tetrahedron_block, real)
    rows = random.normal(size=(free, 3))
    h = 1e9 * rows.T @ rows
    six = [real(h[i, j]) for i, j in PARTS]
    trace = six[0] + six[3] + six[5]
    six.append(real(1) / trace)
    way = rows.T @ random.normal(size=(free, free)) @ rows
    q = (way + way.T) / 2 / 2  # L H + H L = 4 Q has a solution: L = way + way' on the span of rows
    found = matrix(formulas.symmetric(six, [real(q[i, j]) for i, j in PARTS]))
    assert np.isfinite(formulas.skew(six, (real(1), real(-1), real(0.5)))).all()
    inside = rows @ (found @ h + h @ found) @ rows.T / 2
    np.testing.assert_allclose(inside, rows @ q @ rows.T, rtol=0, atol=1e-3 * (1 + np.abs(inside).max()))


def test_nothing_moves_where_nothing_can() -> None:
    """H is 0 where all corners are pinned and the compliance is below the smallest number."""
    formulas, none = plain_formulas(tetrahedron_block, np.float32), [np.float32(0)] * 7
    assert formulas.symmetric(none, none[:6]) == (0,) * 6 and formulas.skew(none, none[:3]) == (0,) * 3
