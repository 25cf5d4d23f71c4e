"""A run that breaks says so: the right step, the right particle, and a state that is still finite."""

import numpy as np
import pytest
from fake_cloth import FakeCloth

from softlab.bench.reference import mass_spring as reference
from softlab.model.base.errors import Diverged
from softlab.model.core.build import build
from softlab.model.core.stability.divergence import MAX_INTERVAL, MIN_INTERVAL, check_interval
from softlab.model.scene.scene import Scene, load_scene

FARTHEST = 1e6  # times a scene's size: what the lab promises to call diverged
CHECK_INTERVAL = 256  # steps, set by hand where a test needs several looks in a short run


def small(name: str, dt: float) -> Scene:
    changes = {"grid.rows": 8, "grid.columns": 9, "method.integrator": name, "method.dt": dt}
    return load_scene("lab-hammock").replace(changes)


def reference_says(scene: Scene, steps: int) -> tuple[int, int]:
    found = reference.first_diverged(scene, steps, FARTHEST * build(scene).size)
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("name", "dt"),
    [("lab", 0.1), ("semi-implicit-euler", 0.06), ("velocity-verlet", 0.1), ("rk4", 0.06), ("taylor", 0.02)],
)
def test_diverged_names_step_and_particle(opened, name, dt, kernel):
    """B8: far over the limit (lab: 0.03125 s) the motion overflows within 200 steps. The first bad step and its lowest
    bad particle are the reference's, which looks after every step; the message names the step size that holds."""
    scene = small(name, dt)
    step, particle = reference_says(scene, 200)
    with opened(scene, kernel=kernel) as simulation:
        simulation.check_interval = CHECK_INTERVAL
        with pytest.raises(Diverged) as caught:
            simulation.advance(3 * CHECK_INTERVAL)
        assert (caught.value.step, caught.value.particle) == (step, particle)
        assert caught.value.limit == simulation.limit < dt
        assert f"step {step}, particle {particle}" in str(caught.value)
        assert f"{simulation.limit:.6g}" in str(caught.value)
        state = simulation.state()  # the last that was checked and good: the start
        assert (state.step, state.time) == (0, 0.0)
        assert np.array_equal(state.position, build(scene).position)


def test_state_after_divergence_is_the_last_checked_one(opened):
    """A slow growth passes several checks first: the state that is left is
    the one of the last check, finite, at a multiple of the interval, and running on from it fails at the same step."""
    scene = small("taylor", 0.006)  # its limit is 0.00075 s: amplitudes grow by dt (dt w^2 - gamma) / 2, 3 % a step
    step, particle = reference_says(scene, 6 * CHECK_INTERVAL)
    assert step > CHECK_INTERVAL
    with opened(scene) as simulation:
        simulation.check_interval = CHECK_INTERVAL
        with pytest.raises(Diverged) as caught:
            simulation.advance(10_000)
        assert (caught.value.step, caught.value.particle) == (step, particle)
        state = simulation.state()
        assert state.step == (step - 1) // CHECK_INTERVAL * CHECK_INTERVAL
        assert np.isfinite(state.position).all() and np.isfinite(state.velocity).all()
        assert state.time == pytest.approx(state.step * 0.006, rel=1e-12)
        with pytest.raises(Diverged) as again:
            simulation.advance(2 * CHECK_INTERVAL)
        assert (again.value.step, again.value.particle) == (step, particle)


def test_reading_the_state_checks_it(opened):
    """Between two checks a broken state is not handed out: state() looks, and raises."""
    with opened(small("lab", 0.1)) as simulation:
        simulation.advance(CHECK_INTERVAL - 1)
        with pytest.raises(Diverged):
            simulation.state()
        assert simulation.state().step == 0


def test_float32_reports_the_same_way(opened):
    """float32 overflows at 3e38: never a NaN handed out, and a step within the rounding of the reference's."""
    scene = small("lab", 0.1)
    step, _ = reference_says(scene, 200)
    with opened(scene, precision="float32") as simulation:
        simulation.check_interval = CHECK_INTERVAL
        with pytest.raises(Diverged) as caught:
            simulation.advance(1000)
        assert abs(caught.value.step - step) <= 2
        assert np.isfinite(simulation.state().position).all()


def test_looks_are_rarer_for_small_grids():
    """Looking takes at least 0.05 ms: the interval grows where a step takes microseconds, within bounds."""
    for backend, most in MAX_INTERVAL.items():
        assert check_interval(1, backend) == check_interval(1024, backend) == most
        assert check_interval(2**26, backend) == MIN_INTERVAL
        assert MIN_INTERVAL < check_interval(256 * 256, backend) <= most


class Thrown(FakeCloth):
    """One mass that a step throws so many times the scene's size away."""

    far = 0.0

    def _run(self, steps):
        self._position[3, 1] = self.far * self.body.size


@pytest.mark.parametrize(
    ("times", "diverged"), [(0.99, False), (1.01, True), (-0.99, False), (-1.01, True), (np.nan, True)]
)
@pytest.mark.parametrize("spacing", [1.0, 1e-3])
def test_a_coordinate_beyond_a_million_times_the_size_has_diverged(times, diverged, spacing):
    scene = load_scene("cloth-hanging").replace({"cloth.rows": 3, "cloth.columns": 3, "cloth.spacing": spacing})
    simulation = Thrown(scene)
    simulation.far = times * FARTHEST
    simulation.advance(1)
    if not diverged:
        simulation.check()
        return
    with pytest.raises(Diverged) as caught:
        simulation.check()
    assert (caught.value.step, caught.value.particle) == (1, 3)
