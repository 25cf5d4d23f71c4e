"""The position-based solvers on CPU threads against the independent NumPy reference, and what a simulation owes its user."""

from __future__ import annotations

import numpy as np
import pytest
from xpbd_scenes import PARTS, poke_of, xpbd_scene
from xpbd_solve import STEPS, end_state

from softlab.app.driver import open_simulation
from softlab.bench.reference import xpbd as reference
from softlab.model.base.errors import SceneError
from softlab.model.core.build import build, rest_positions
from softlab.model.core.simulation import State
from softlab.model.geometry.normals import vertex_normals
from softlab.model.scene.scene import Scene

ORDERINGS = {"gauss-seidel": "gauss-seidel", "jacobi": "weighted-jacobi", "averaged-jacobi": "averaged-jacobi"}
OTHERS = (
    "held",
    "net",
    "everything",
    "damped",
    "pbd",
)  # the reference has no attachments, one compliance 0 or none, no PBD


def judged(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """The reference's (position, velocity) after STEPS."""
    method, inverse = scene.method, build(scene).inverse_mass
    masses = np.where(inverse > 0, 1 / np.where(inverse > 0, inverse, 1), scene.grid.mass)
    return reference.simulate(
        scene, STEPS, poke=poke_of(scene), substeps=method.substeps, iterations=method.iterations,
        ordering=ORDERINGS[method.ordering], masses=masses, inextensible=scene.name in ("rigid", "pbd"),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "ordering"),
    [
        *((name, "gauss-seidel") for name in PARTS if name not in OTHERS),
        *((name, "jacobi") for name in ("loaded", "alternating", "stretchy", "free")),
        *((name, "averaged-jacobi") for name in ("loaded", "alternating")),
    ],
)
def test_stages_follow_the_reference(name: str, ordering: str) -> None:
    """Of an iteration's twelve projections of a mass each rounds its position some four times; velocities are positions over
    h; a bullet's catch is as much worse as it is faster than the sheet: 400 m/s against 1 m."""
    scene = xpbd_scene(name, ordering, substeps=2, iterations=2)
    position, velocity = judged(scene)
    state = end_state(scene, kernel="stages", threads=2)
    bound = STEPS * 4 * 48 * np.finfo(np.float64).eps * max(1.0, float(np.abs(position).max()))
    assert np.abs(state.position - position).max() < bound
    bound = max(bound, STEPS * np.finfo(np.float64).eps * float(np.abs(velocity).max()))
    assert np.abs(state.velocity - velocity).max() < bound * scene.method.substeps / scene.method.dt


def test_pbd_of_the_whole_stretch_is_an_inextensible_xpbd() -> None:
    scene = Scene(xpbd_scene("pbd").replace({"method.pbd_stiffness": 1.0}).as_dict(), "pbd")
    position, _ = judged(scene)
    assert np.abs(end_state(scene, kernel="stages").position - position).max() < STEPS * 4 * 72 * np.finfo(float).eps


def test_fast_math_stays_near_exact() -> None:
    """Contraction and approximate roots: of a projection's result some 4 units in the last place of coordinates of 1 m, and
    12 projections in each of 3 x 3 iterations of 4 steps, which damp errors rather than let them grow."""
    scene = xpbd_scene("grid", rows=17, columns=35)
    exact = end_state(scene, precision="float32")
    fast = end_state(scene, precision="float32", math="fast", threads=2)
    moved = float(np.abs(exact.position).max())
    assert 0 < np.abs(fast.position - exact.position).max() < 4 * 12 * 9 * STEPS * 2**-24 * max(1.0, moved)


def test_states_go_in_and_out_as_they_are() -> None:
    """Rows are combed inside. And a divergence names the particle, whatever column lies where."""
    scene = xpbd_scene("springs", rows=9, columns=35)
    random = np.random.default_rng(5)
    body = build(scene)
    velocity = np.where(body.inverse_mass[:, None] > 0, random.normal(size=body.position.shape), 0.0)
    position = body.position + random.normal(0, 1e-3, body.position.shape)
    with open_simulation(scene, precision="float64", math="exact", threads=2) as simulation:
        simulation.load(State(position, velocity, body.inverse_mass, 0.5, 3))
        state = simulation.state()
        assert np.array_equal(state.position, position) and np.array_equal(state.velocity, velocity)
        assert (state.step, state.time) == (3, 0.5)
        assert np.array_equal(simulation.read("position"), position)
        assert np.abs(simulation.read("normal") - vertex_normals(position, 9, 35)).max() < 1e-12
        for particle in (0, 35, 36, 37, 38, 300):
            bad = velocity.copy()
            bad[particle] = bad[-1] = 1e300  # finite, and out of bounds at once
            simulation._upload(position, bad)
            simulation._upload(np.where(np.abs(bad) > 1e9, 1e300, position), velocity)
            assert simulation._first_diverged() == particle


def test_what_a_position_based_solver_cannot_be_run_with_is_refused() -> None:
    scene = xpbd_scene("bare")
    with pytest.raises(SceneError, match=r"^kernel.*fused, stages"):
        open_simulation(scene, kernel="team")
    with open_simulation(scene) as simulation:
        assert simulation.kernel == "fused"


def test_attachments_hold_every_mass() -> None:
    """To the farther of both anchors, which pulls last, but for a rounding of each number; else some would be farther."""
    scene = xpbd_scene("held", rows=17, columns=9, pinned="top-corners", iterations=1)
    loose = Scene({name: part for name, part in scene.as_dict().items() if name != "attachments"})
    rest, excess = rest_positions(scene.grid), []
    reaches = [np.linalg.norm(rest - rest[pin], axis=1) * 1.001 for pin in (0, 8)]
    farther = np.argmax(reaches, axis=0)
    for tied in (scene, loose):
        position = end_state(tied, (30,), kernel="stages").position
        ways = [np.linalg.norm(position - position[pin], axis=1) for pin in (0, 8)]
        excess.append((np.choose(farther, ways) - np.choose(farther, reaches)).max())
    assert excess[0] < 8 * np.finfo(float).eps < excess[1]
