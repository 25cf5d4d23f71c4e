"""Laws that the position-based solvers keep: closed forms of their fixed points, conserved quantities, orders of convergence.

What the same laws say of the NumPy reference is in test_xpbd_reference.py; here they hold the solvers, in float64.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from xpbd_scenes import HEAVY_END, PUBLISHED

from softlab.bench.reference import mass_spring
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.position_based.plan import xpbd_parts
from softlab.model.scene.scene import Scene, load_scene

G = 9.81
FRAME = 1 / 60
ORDERINGS = ("gauss-seidel", "jacobi")
Run = Callable[..., State]


@pytest.fixture
def stepped(opened: Callable[..., Any]) -> Run:
    """stepped(scene, steps, position=..., velocity=..., kernel="stages") -> State, from such a start."""

    def run(scene: Scene, steps: int, position: Any = None, velocity: Any = None, kernel: str = "stages") -> State:
        body = build(scene)
        begin = [
            own.copy() if given is None else np.asarray(given, float).reshape(own.shape)
            for given, own in ((position, body.position), (velocity, body.velocity))
        ]
        with opened(scene, kernel=kernel) as simulation:
            simulation.load(State(*begin, body.inverse_mass, 0.0, 0))
            simulation.advance(steps)
            return simulation.state()

    return run


def chain(links: int, length: float, compliance: float, mass: float = 0.01, **parts: Any) -> Scene:
    """A column of masses that hangs from its first one; keywords are tables, those of `method` fields."""
    method = {"solver": "xpbd", "dt": FRAME} | parts.pop("method", {})
    return Scene(
        {
            "grid": {"rows": links + 1, "columns": 1, "spacing": length, "mass": mass, "pinned": "top"},
            "springs": {"compliance": compliance, "rest_length": length},
            "method": method,
            **parts,
        }
    )


@pytest.mark.parametrize("iterations", [1, 2, 7, 50])
@pytest.mark.parametrize("ordering", [*ORDERINGS, "averaged-jacobi"])
def test_one_constraint_is_backward_euler(stepped: Run, ordering: str, iterations: int) -> None:
    """XPBD 2016, fig. 2, for any number of iterations, since multipliers live through them: x_n - 1 = r^n cos(n a) / 2 with
    r = 1/sqrt(1 + h^2/alpha), a = atan(h/sqrt(alpha)); 0.9949068625 after 30 steps. Some ten roundings of 1 m a step."""
    scene = chain(1, 1.0, 0.001, 1.0, method={"ordering": ordering, "iterations": iterations})
    state = stepped(scene, 30, [[0.0, 0.0], [0.0, -1.5]])
    decay, phase = 1 / np.sqrt(1 + FRAME**2 * 1000), np.arctan(FRAME * np.sqrt(1000))
    exact = 1 + decay**30 * np.cos(30 * phase) / 2
    assert exact == pytest.approx(0.9949068625, abs=5e-11)
    assert -state.position[1, 1] == pytest.approx(exact, abs=30 * 10 * 2**-53 * iterations)


@pytest.mark.parametrize("ordering", ORDERINGS)
def test_a_rigid_rope_is_too_long_by_h_squared(stepped: Run, ordering: str) -> None:
    """What the links below still move a link after its projection: proportional to g h^2, with a constant of the ordering.

    The ascending order's is n (n - 1) / 2 = 45; with the even links first it is 49. At rest link i, which carries n - i + 1
    masses, takes away as many g h^2 times its weight in one Jacobi iteration: 2 at the pin, 4, 3 at the end; the fall of
    a substep is seen by the first link alone, one g h^2: 20 + 4 * 44 + 3 - 1 = 198.
    """
    n, constant = 10, {"gauss-seidel": 49, "jacobi": 198}[ordering]
    for h in (FRAME, FRAME / 10):
        scene = chain(
            n, 1.0, 0.0, gravity={}, damping={"coefficient": 0.3 * 0.01 / h}, method={"ordering": ordering, "dt": h}
        )
        rest = build(scene).position
        state = stepped(scene, 1500, rest * (1 + constant * G * h * h / n))
        assert -state.position[-1, 1] - n == pytest.approx(constant * G * h * h, rel=1e-6)


def test_a_link_that_did_not_give_takes_a_live_stiffness(opened: Any) -> None:
    """At rest by m g / k longer; damped critically, so that 5 s are 50 of its times. Where the stiffness is not live, nothing
    of compliance is compiled in."""
    scene = chain(1, 1.0, 0.0, gravity={}, damping={"coefficient": 0.2})
    assert "structural-compliance" not in xpbd_parts(scene) and "structural-compliance" in xpbd_parts(
        scene, frozenset({"stiffness"})
    )
    with opened(scene, kernel="stages", live=("stiffness",)) as simulation:
        simulation.advance(60)
        assert simulation.read("position")[1, 1] == pytest.approx(-1.0, abs=1e-12)
        simulation.set("springs.stiffness", 1.0)
        simulation.advance(300)
        assert simulation.read("position")[1, 1] == pytest.approx(-1 - 0.01 * G, abs=1e-12)


@pytest.mark.parametrize(("substeps", "iterations", "ordering", "percent"), HEAVY_END)
def test_mass_ratio_1000(opened: Any, substeps: int, iterations: int, ordering: str, percent: float) -> None:
    """20 links of 0.05 m, 1 g a mass and 1 kg at the end, inextensible: largest stretch in the frames 20 to 40, as the
    reference has it (three digits; of 1.01 two). Substeps do what iterations do not."""
    scene = chain(
        20, 0.05, 0.0, 0.001, gravity={}, weight={"kind": "load", "at": [20, 0], "mass": 1.0},
        method={"substeps": substeps, "iterations": iterations, "ordering": ordering},
    )  # fmt: skip
    stretches = []
    with opened(scene, kernel="stages") as simulation:
        for _ in range(40):
            simulation.advance(1)
            stretches.append(100 * (-simulation.read("position")[-1, 1] - 1))
    assert max(stretches[19:]) == pytest.approx(percent, rel=6e-3)


def test_small_steps_rope(opened: Any) -> None:
    """Small Steps 2019, 6.1: 20 particles, 1 : 1e5: 99.4 m with 100 iterations, 1.00 m with 100 substeps, a hundredth.

    The mass swings on the rope's give, so the largest error comes after half a period: 7.2 s and 0.72 s.
    """
    errors = []
    for substeps, iterations, seconds in ((1, 100, 7.6), (100, 1, 0.76)):
        scene = chain(
            19, 0.01, 0.0, 1.0, gravity={"acceleration": 10.0}, weight={"kind": "load", "at": [19, 0], "mass": 1e5},
            method={"substeps": substeps, "iterations": iterations},
        )  # fmt: skip
        deepest = 0.0
        with opened(scene, kernel="fused") as simulation:
            for _ in range(round(seconds / FRAME)):
                simulation.advance(1)
                deepest = max(deepest, -simulation.read("position")[-1, 1])
        errors.append(deepest - 0.19)
    assert errors[0] / errors[1] == pytest.approx(100, abs=3)
    assert errors == pytest.approx([99.4, 1.00], rel=5e-3)


SHEETS = {"S1": "top", "S2": "top-corners"}


@pytest.fixture(scope="module")
def truth() -> dict[str, np.ndarray]:
    """Where the lab's sheets are after 1.5 s, by RK4 at 0.0025 s (its error: 1e-7 m)."""
    return {
        name: mass_spring.simulate(lab_sheet(name).replace({"method.dt": 0.0025}), 600, integrator="rk4")[0]
        for name in SHEETS
    }


def lab_sheet(name: str) -> Scene:
    return load_scene("lab-hammock").replace(
        {"grid.rows": 32, "grid.columns": 32, "grid.pinned": SHEETS[name], "perturbation.amplitude": 0.05}
    )


@pytest.mark.parametrize(("sheet", "dt", "iterations", "error"), PUBLISHED)
def test_error_against_the_motion_of_the_springs(
    stepped: Run, truth: dict[str, np.ndarray], sheet: str, dt: float, iterations: int, error: float
) -> None:
    """Lab sheets of 32 x 32 after 1.5 s, RMS over all masses. The numbers come from a prototype in which the columns were
    projected first: three digits, and a thousandth for that; two digits of the last ones."""
    lab = lab_sheet(sheet)
    scene = Scene(lab.as_dict() | {"method": {"solver": "xpbd", "dt": dt, "iterations": iterations}})
    position = stepped(scene, round(1.5 / dt), kernel="fused").position
    digits = 6e-3 if error < 1e-3 else 2.5e-3
    assert np.sqrt(((position - truth[sheet]) ** 2).sum(axis=1).mean()) == pytest.approx(error, rel=digits)


@pytest.mark.parametrize("ordering", ORDERINGS)
def test_tethers_hold_a_chain_of_4096(stepped: Run, ordering: str) -> None:
    """B13: an inextensible chain with one iteration a substep sags by kilometres (g h^2 n (n - 1) / 2); with attachments no
    mass is farther from the pin than it may be: the last thing an iteration does, exact to a rounding of the way."""
    scene = chain(4096, 1.0, 0.0, gravity={}, attachments={"slack": 0.01}, method={"ordering": ordering})
    position = stepped(scene, 600, kernel="fused").position
    reach = 1.01 * np.arange(4097)
    way = np.linalg.norm(position - position[0], axis=1)
    assert np.isfinite(position).all() and (way <= reach * (1 + 4 * 2**-52)).all()
    loose = Scene({name: part for name, part in scene.as_dict().items() if name != "attachments"})
    assert -stepped(loose, 600, kernel="fused").position[-1, 1] > 1.02 * 4096
