"""Friction where nothing slides (github.com/spiriMirror/libuipc, issue 442): a rounding must not choose another step."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.base.variant import plain_formulas
from softlab.model.formulas.elastic import friction
from softlab.model.scene.scene import Scene


def dropped(factor: float, floor_kind: str = "plane", **method: float | str) -> np.ndarray:
    """Positions (particles, 3), over `factor`, of a box after its first touch of a floor, a plane or a pinned body; all
    lengths times the factor."""
    box = {
        "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.2 * factor] * 3}, "edge": 0.2 * factor,
        "origin": [0.013 * factor, 0.115 * factor, 0.007 * factor], "young_modulus": 1e4, "poisson_ratio": 0.3,
    }  # fmt: skip
    friction = {"static_friction": 0.6, "dynamic_friction": 0.5}
    parts: dict[str, dict] = {"floor": {"kind": "plane"} | friction}
    if floor_kind == "body":
        slab = {"sides": [0.6 * factor, 0.2 * factor, 0.6 * factor]}
        pinned = {"origin": [0.0, -0.105 * factor, 0.0], "pinned": ["top", "bottom", "left", "right"]}
        parts = {"slab": box | {"shape": {"name": "box"} | slab} | pinned}
        parts["contact"] = friction | {"distance": 0.01 * factor, "separation_speed": 3.0 * factor, "sweeps": 4}
    parts |= {"box": box, "gravity": {"acceleration": 9.81 * factor}, "method": {"dt": 1 / 60} | method}
    scene = Scene(parts)
    with open_simulation(scene, precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(5)
        return simulation.read("position")[scene.tetrahedra_set.first_particle[-1] :] / factor


@pytest.mark.parametrize("iterations", [1, 4])
def test_a_rounding_of_the_size_changes_a_rounding_of_the_motion(iterations: int) -> None:
    """A box and one 1 + 2^-40 times as large touch a floor without sliding. Places are off by 2^-53 of 0.2 m, magnified by
    contacts ten times as hard as what holds a vertex and by four steps: less than 1e4. SLIP and SMALLEST are no lengths of
    the scene: 2^-40 of them. They were 2e-4 m apart, since exactly 0 slip had no friction's block."""
    one, other = (dropped(factor, solver="vbd", iterations=iterations) for factor in (1.0, 1 + 2.0**-40))
    assert one[:, 1].min() < 0.02  # it touches
    np.testing.assert_allclose(other, one, atol=1e4 * 0.2 * 2.0**-53 + 0.1 * 2.0**-40)


@pytest.mark.parametrize(("solver", "floor"), [("xpbd", "plane"), ("newton", "plane"), ("xpbd", "body")])
def test_other_solvers_have_no_step_at_zero_slip(solver: str, floor: str) -> None:
    """Nor is a body that is dropped on a pinned one, whose surface rubs it. Newton's method ends within its tolerance."""
    one, other = (dropped(factor, floor, solver=solver) for factor in (1.0, 1 + 2.0**-40))
    assert one[:, 1].min() < 0.02  # it touches
    np.testing.assert_allclose(other, one, atol=1e-8 if solver == "newton" else 1e4 * 0.2 * 2.0**-53)


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("normal", [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.6, 0.64, 0.48)])
def test_the_block_is_continuous_at_no_slip(real: type, normal: tuple[float, float, float]) -> None:
    """Of a velocity that loses mu = 0.5 of 1 m/s along the way: the block at 0 and at ways down to the least number is
    mu lambda / (h SLIP) (I - nn'), the derivative within that times the way."""
    formulas, h, hard, depth, mu = plain_formulas(friction, real), real(0.01), real(100), real(1e-3), 0.5
    n = (depth, *(real(one) for one in normal))
    across = np.cross(normal, (0.3, 0.5, -0.7))
    across /= np.linalg.norm(across)
    want = mu * 0.1 / (0.01 * friction.SLIP) * (np.eye(3) - np.outer(normal, normal))
    left = tuple(real(1e-18 * one) for one in normal)  # what rounding leaves along the normal has no direction
    assert abs(np.dot(formulas.heading(n, (real(1e-18), *left)), normal)) < 1e-6
    for size in (0.0, np.finfo(real).tiny, 1e-30, 1e-18, 1e-8, 5e-5):
        u = tuple(real(one) for one in size * across)
        slip = (real(np.linalg.norm(u)), *u)
        t = formulas.heading(n, slip)
        assert abs(np.dot(t, normal)) < 1e-6 and np.linalg.norm(t) == pytest.approx(1, rel=1e-5)
        v = formulas.sliding((real(0),) * 3, n, t)
        w = tuple(one - real(mu) * other for one, other in zip(v, t, strict=True))
        x, y, z, xx, yy, zz, xy, xz, yz = formulas.rubbed(v, w, n, slip, t, hard, h)
        block = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        np.testing.assert_allclose(block, want, atol=1e-5 * np.abs(want).max())
        np.testing.assert_allclose([x, y, z], want @ (size * across), atol=1e-5 * np.abs(want).max() * size)
