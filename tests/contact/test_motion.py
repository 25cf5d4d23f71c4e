"""Pins that follow a path: the arithmetic, where they are at any time, one answer from both CPU kernels and the reference."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any

import numba
import numpy as np
import pytest
from cloth_scenes import POKE, cloth_scene
from cloth_solve import cloth

from softlab.app.driver import open_simulation
from softlab.bench.reference import cloth as reference_cloth
from softlab.bench.reference import mass_spring as reference
from softlab.model.base.clock import START
from softlab.model.base.errors import Diverged
from softlab.model.base.variant import Variant, plain_formulas
from softlab.model.core.build import build
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.simulation import State
from softlab.model.formulas import motion
from softlab.model.scene.scene import Scene

BOTH = pytest.mark.parametrize("real", [np.float32, np.float64])


def turns_to_try(real: Any) -> np.ndarray:
    """Around every eighth of a turn, near nothing, and up to where an angle has hardly a digit left."""
    eighths = np.arange(-16, 17, dtype=real) / real(8)
    random = np.random.default_rng(5)
    around = [np.nextafter(eighths, real(side)) for side in (-np.inf, np.inf)]
    spread = random.uniform(-1, 1, 3000) * 10.0 ** random.uniform(-30, 5, 3000)
    return np.concatenate([eighths, *around, spread.astype(real)])


@BOTH
def test_sine_and_cosine_are_within_two_units_in_the_last_place_of_one(real: Any) -> None:
    """4u, as the docstring adds up, against 64 bits of `longdouble`; a small sine to 4u of itself. What was taken off in
    whole turns is exact, so that this holds for any angle."""
    if np.finfo(np.longdouble).nmant < 63:
        pytest.skip("needs a longdouble of 64 bits to judge by")
    u = np.finfo(real).eps / 2
    formulas = plain_formulas(motion, real)
    for turns in turns_to_try(real):
        sine, cosine = formulas.sine_cosine(turns)
        rest = np.longdouble(turns) - np.round(np.longdouble(turns))
        angle = 2 * rest * (np.longdouble(pi) + np.longdouble(1.2246467991473532e-16))  # pi to 64 bits: two doubles
        scale = max(abs(np.sin(angle)), np.finfo(real).tiny) if abs(rest) < 1 / 8 else 1
        assert type(sine) is real and type(cosine) is real
        assert abs(sine - np.sin(angle)) <= 4 * u * scale, turns
        assert abs(cosine - np.cos(angle)) <= 4 * u, turns


@BOTH
def test_compiled_formulas_give_the_bits_of_plain_python(real: Any) -> None:
    plain, fast = plain_formulas(motion, real), Variant(real, numba.njit(error_model="numpy")).of(motion)
    random = np.random.default_rng(6)
    for turns in turns_to_try(real)[::7]:
        assert plain.sine_cosine(turns) == fast.sine_cosine(turns)
        numbers = random.uniform(-2, 2, 13).astype(real)
        now = plain.turn(turns, real(0.5), real(3), numbers[12])
        assert now == fast.turn(turns, real(0.5), real(3), numbers[12])
        path = (*map(tuple, numbers[:12].reshape(4, 3)), numbers[12], now)
        assert plain.placed(*path) == fast.placed(*path)
    clock = real(0.1), real(11), real(0.7)
    assert plain.middle(12345, *clock) == fast.middle(12345, *clock)


def test_the_velocity_is_the_positions_derivative() -> None:
    """By central differences in float64: h^2 w^3 r / 6 = 2e-9 m/s of truncation, 1e-16 / h of rounding."""
    formulas = plain_formulas(motion, np.float64)
    axis = np.array([1.0, -2.0, 0.5]) / np.sqrt(5.25)
    path = (0.3, -0.2, 1.0), (0.1, 0.2, 0.3), axis, (0.4, 0.5, -0.6), 3.0

    def at(time: float) -> np.ndarray:
        return np.array(formulas.placed(*path, formulas.turn(time, 0.25, 2.0, 3.0 / (2 * pi))))

    h = 1e-5
    for time in (0.1, 0.4, 1.0, 2.2, 2.5):
        slope = (at(time + h)[:3] - at(time - h)[:3]) / (2 * h)
        assert at(time)[3:] == pytest.approx(slope, abs=5e-9)
    assert not at(0.24)[3:].any() and not at(2.25)[3:].any() and at(0.25)[3:].any()
    assert at(0.0)[:3].tolist() == list(path[0])  # before it begins: the very place


def ends(rows: int, columns: int) -> dict[str, Any]:
    """A sheet whose left and right sides turn opposite ways, the right one also moving in."""
    left, right = ([[i, j] for i in range(rows)] for j in (0, columns - 1))
    return {
        "sheet": {"pinned": left + right, "spacing": 0.1},
        "left": {"kind": "motion", "pins": left, "center": [0.0, -0.15, 0.0], "angular_velocity": 9.0, "duration": 0.3},
        "right": {
            "kind": "motion", "pins": right, "center": [0.0, -0.15, 0.0], "angular_velocity": -5.0, "start": 0.05,
            "duration": 0.2, "velocity": [-0.5, 0.0, 0.1],
        },
    }  # fmt: skip


SPRINGS = {
    "structural": {"stiffness": 60.0, "damping": 0.01},
    "shear": {"stiffness": 20.0},
    "gravity": {},
    "damping": {"coefficient": 0.01},
}


@pytest.mark.parametrize(
    ("integrator", "precision"),
    [("velocity-verlet", "float32"), ("velocity-verlet", "float64"), ("rk4", "float32"), ("taylor", "float64")],
)
def test_pins_are_where_their_motion_has_them(integrator: str, precision: str) -> None:
    """At any time, to rounding: of the time 2u, of the seconds passed and of the turns u each, so 5u of an angle of at most
    2.7, over a radius of 0.2 m; and 4u of sums of coordinates of up to 0.7 m. The velocity is 9/s of that."""
    dt = 1e-5 if integrator == "taylor" else 0.002
    scene = cloth(4, 7, **ends(4, 7), **SPRINGS, method={"integrator": integrator, "dt": dt})
    pinned = build(scene).pinned
    bound = np.finfo(precision).eps / 2 * (0.2 * (5 * 2.7 + 8) + 4 * 0.7)
    with open_simulation(scene, precision=precision, math="exact") as simulation:
        for steps in (0, 1, 7, 50, 60, 90):
            simulation.advance(steps)
            state = simulation.state()
            zero = np.zeros((4, 7, 3))
            position, velocity = reference_cloth.follow(scene, reference.rest(scene), zero, state.step * dt)
            assert np.abs(state.position[pinned] - position.reshape(-1, 3)[pinned]).max() < bound
            assert np.abs(state.velocity[pinned] - velocity.reshape(-1, 3)[pinned]).max() < 9 * bound
            assert velocity.any() == (state.step * dt < 0.3)
        assert integrator == "taylor" or state.step * dt > 0.3


def test_time_goes_on_from_where_the_step_size_was_changed() -> None:
    """Pins by the closed form of their path at the true time, and everything that moves from it by the bits of a run whose
    steps are numbered otherwise: what happens depends on when it is, and not on how many steps there were."""
    scene = cloth_scene("damped moving", "velocity-verlet")
    dt, pinned = scene.method.dt, build(scene).pinned
    options = {"precision": "float32", "math": "exact", "threads": 1, "allow_unstable": True}
    with open_simulation(scene, live=("poke", "dt"), **options) as simulation:
        simulation.advance(9)
        simulation.set("method.dt", 2 * dt)
        changed = simulation.state()
        assert (changed.step, changed.time) == (9, 9 * dt)
        simulation.advance(2)
        half = simulation.state()
        simulation.advance(1)
        end = simulation.state()
        assert (end.step, end.time) == (12, pytest.approx(15 * dt, rel=1e-12))
        expected, _ = reference_cloth.follow(scene, reference.rest(scene), np.zeros((7, 6, 3)), 15 * dt)
        # 5u of an angle of 0.3 at most, over 1 m at most, and 4u of sums of coordinates of 1 m: see the test above
        off = np.abs(end.position - expected.reshape(-1, 3))[pinned].max()
        assert off < np.finfo(np.float32).eps / 2 * 7
        simulation.load(half)  # continues to the bit, with the clock that it has
        simulation.advance(1)
        assert same(simulation.state(), end)
    coarse = scene.replace({"method.dt": 2 * dt})
    for step in (0, 9, 1000):  # as another run's, whose step size was never this one
        with open_simulation(
            coarse, live=("poke",), initial=replace(changed, step=step, clock=START), **options
        ) as other:
            assert (other.step, other.time) == (step, changed.time)
            other.advance(3)
            assert same(other.state(), end)


def stepped(scene: Scene, batches: tuple[int, ...] = (5, 12, 1, 7), poke: bool = True, **options: Any) -> State:
    live = ("poke",) if poke else ()
    with open_simulation(scene, allow_unstable=True, math="exact", live=live, **options) as simulation:
        if poke:
            simulation.poke(*POKE)
        for steps in batches:
            simulation.advance(steps)
        return simulation.state()


def same(a: State, b: State) -> bool:
    return np.array_equal(a.position, b.position) and np.array_equal(a.velocity, b.velocity)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_reference_is_met(integrator: str) -> None:
    """In float64 the two differ by rounding alone: of coordinates of 1 m some ten times a step, and a difference grows no
    faster than the square of the steps over so short a time: 25^2 * 10 * 2^-53 = 7e-13; speeds by that over dt."""
    scene = cloth_scene("moving", integrator)
    state = stepped(scene, kernel="stages", precision="float64", threads=2)
    position, velocity = reference.simulate(scene, 25, poke=POKE)
    assert np.abs(state.position - position).max() < 7e-13
    assert np.abs(state.velocity - velocity).max() < 7e-13 / scene.method.dt


def test_the_interval_in_which_a_state_went_bad_is_replayed_with_its_motions() -> None:
    scene = cloth_scene("moving", "semi-implicit-euler").replace({"method.dt": 0.02})
    with open_simulation(scene, kernel="stages", precision="float64", math="exact", allow_unstable=True) as simulation:
        bound = simulation._bound
        with pytest.raises(Diverged) as caught:
            simulation.advance(900)
            simulation.check()
        assert simulation.step == 0
    assert (caught.value.step, caught.value.particle) == reference.first_diverged(scene, 900, bound)
