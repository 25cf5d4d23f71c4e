"""The hand on a body, without a window: its force, who shares it, and bodies that come to the pointer and stay whole."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies_scenes import BAR, BRICK, bodies_scene
from fake_cloth import FakeCloth

from app.demo import Demo
from app.grip import CALMING, GIVE, HAND, SLOWING, STEADY, Grip
from app.worlds import live_parts
from model.cluster_tables import matching_factors
from model.errors import SceneError
from model.scene import Scene
from model.simulation import Options

SOFT = BAR | {"spin": [0.0, 0.0, 0.0], "cluster_stiffness": 4000.0}  # 24 particles, 3 clusters
HARD = BRICK | {"spin": [0.0, 0.0, 0.0], "origin": [0.0, 2.0, 0.0]}
SCENE = bodies_scene(bar=SOFT, brick=HARD)
CROWD = SCENE.crowd
DT = SCENE.method.dt


class Jellies(FakeCloth):
    """Clusters move particles to their goals (model/clusters.py), in NumPy: a substep a step, nothing to compile."""

    def _run(self, steps: int) -> None:
        clusters, dt = self.scene.crowd.clusters, self.scene.method.dt
        factor = matching_factors(clusters, dt, 1)  # of each entry, its share in it
        gravity = self.scene.gravity
        fall = gravity.acceleration if gravity is not None and gravity.enabled else 0.0
        for _ in range(steps):
            before = self._position
            self._velocity = self._velocity - [0.0, dt * fall, 0.0]
            moved = before + dt * self._velocity
            change = factor[:, None] * (clusters.goals(moved) - moved[clusters.indices])
            sums = [np.bincount(clusters.indices, axis, len(moved)) for axis in change.T]
            self._position = moved + np.stack(sums, axis=1)
            self._velocity = (self._position - before) / dt


def opened(scene: Scene, backend: str = "cpu", *, live: Any = (), initial: Any = None, **options: Any) -> Jellies:
    simulation = Jellies(scene, Options("float64", live=frozenset(live)))
    if initial is not None:
        simulation.load(initial)
    return simulation


def momentum(simulation: Any) -> np.ndarray:
    return CROWD.clusters.mass @ simulation.state().velocity.astype(np.float64)


# ---------------------------------------------------------------------- the force


@pytest.mark.parametrize("particle", [0, len(CROWD.position) - 1])
def test_a_pull_gives_the_impulse_of_its_force_to_neighbours_of_the_same_body(particle: int) -> None:
    simulation = opened(SCENE)
    grip = Grip(simulation, particle)
    target = CROWD.position[particle] + (0.1, 0.2, 0.0)
    force = grip.force(simulation, CROWD.position[particle], target, (), DT)
    grip.pull(simulation, target, (), DT)
    np.testing.assert_allclose(momentum(simulation), DT * force, rtol=1e-12)
    moved = np.flatnonzero(simulation.state().velocity.any(axis=1))
    assert (CROWD.body[moved] == CROWD.body[particle]).all() and len(moved) > 4
    speed = np.linalg.norm(simulation.state().velocity[moved], axis=1)
    away = np.linalg.norm(CROWD.position[moved] - CROWD.position[particle], axis=1)
    assert moved[np.argmax(speed)] == particle and (np.diff(speed[np.argsort(away)]) <= 1e-12).all()


def test_the_force_is_a_damped_spring_for_the_bodys_mass_and_carries_its_weight() -> None:
    simulation = opened(SCENE)
    brick = len(CROWD.position) - 1
    grip, place = Grip(simulation, brick), CROWD.position[brick]
    mass = CROWD.clusters.mass[CROWD.body == 1].sum()
    gain = min(mass * HAND**2, STEADY * grip._part / DT**2)  # rigid: it gives way nowhere
    weight = np.array([0, 9.81 * mass, 0])
    assert grip.stiffness(DT) == pytest.approx(gain) and grip.stiffness(1e-6) == pytest.approx(mass * HAND**2)
    np.testing.assert_allclose(grip.force(simulation, place, place, (), DT), weight)
    away = np.array([0.3, 0.1, -0.2]) * grip.extent
    np.testing.assert_allclose(grip.force(simulation, place, place + away, (), DT), gain * away + weight)
    far = grip.force(simulation, place, place + 100 * away, (), DT) - weight
    assert np.linalg.norm(far) == pytest.approx(gain * grip.extent)
    np.testing.assert_allclose(grip.force(simulation, place, None, (0, -1, 0), DT), (0, -gain * grip.extent / 2, 0))
    state = simulation.state()
    simulation.load(type(state)(state.position, state.velocity + np.eye(1, 3), state.inverse_mass, 0.0, 0))
    grip.pull(simulation, place, (), DT)
    slowed = grip.force(simulation, place, place, (), DT) - weight
    damping = min(2 * np.sqrt(gain * mass), SLOWING * grip._part / DT)
    np.testing.assert_allclose(slowed, (-damping, 0, 0), atol=1e-9 * damping)


def test_a_soft_body_is_pulled_no_harder_than_it_holds() -> None:
    """At the limit of the force the pulled part leaves the rest by GIVE of the body's length: F = m w^2 x."""
    grip = Grip(opened(SCENE), 0)
    force = grip.stiffness(1e-6) * grip.extent
    assert force / (grip._part * SOFT["cluster_stiffness"]) <= GIVE * grip.extent * (1 + 1e-12)


# ---------------------------------------------------------------------- the demo


def run(demo: Demo, seconds: float) -> None:
    for _ in range(round(seconds / (demo.steps_per_frame * demo.world.scene.method.dt))):
        demo.frame()


@pytest.mark.parametrize(("number", "steps"), [(0, 2), (1, 2), (0, 10)])
def test_a_held_body_comes_to_the_pointer_whole_and_is_let_go(number: int, steps: int) -> None:
    with Demo([SCENE], precision="float64", open_world=opened) as demo:
        demo.steps_per_frame = steps
        own = np.flatnonzero(CROWD.body == number)
        particle = int(own[0])  # at an end
        target = demo.positions[0][particle] + np.array([0.5, 1.0, -0.3])
        assert demo.take(particle, target) and "selected" in demo.message
        before = demo.positions[0][~np.isin(np.arange(len(CROWD.body)), own)]
        run(demo, 6.0)  # 60 times 1 / HAND, 18 times 1 / CALMING
        held = demo.positions[0][particle]
        # it hangs where it is held; of a soft one the held part is drawn out by its weight, M g / (m w^2)
        grip = demo.hand._grip
        assert grip is not None and not demo.frozen
        sag = 0.0 if number else 9.81 * grip.mass / (grip._part * SOFT["cluster_stiffness"])
        assert np.linalg.norm(held - target) < 0.05 * grip.extent + sag
        assert np.abs(demo.force()[1] / (9.81 * grip.mass) - 1) < 0.2  # no more than its weight
        clusters = CROWD.clusters
        stretched = demo.world.read("position")[own]
        assert np.ptp(stretched, axis=0).max() < 1.5 * grip.extent and np.isfinite(stretched).all()
        others = demo.positions[0][~np.isin(np.arange(len(CROWD.body)), own)]
        assert (others[:, 1] < before[:, 1] - 10).all()  # they fall on as if nobody were there
        demo.release()
        assert demo.force() == (0.0, 0.0, 0.0)
        start = demo.positions[0][own].mean(axis=0)
        run(demo, 0.4)
        fallen = start[1] - (clusters.mass[own] @ demo.positions[0][own])[1] / clusters.mass[own].sum()
        assert fallen == pytest.approx(0.5 * 9.81 * 0.4**2, rel=0.3)
        assert CALMING * DT * steps < SLOWING  # else the hand would have been less calming than told


def test_a_paused_body_is_not_pushed_and_enter_pushes_the_whole_body() -> None:
    weightless = bodies_scene(bar=SOFT, brick=HARD, gravity=0.0)
    with Demo([weightless], precision="float64", open_world=opened) as demo:
        demo.toggle_pause()
        demo.take(0, CROWD.position[0] + (0.0, 1.0, 0.0))
        for _ in range(3):
            demo.drag(*(CROWD.position[0] + (0.0, 2.0, 0.0)))
            demo.frame()
        assert not demo.world.state().velocity.any() and demo.force()[1] > 0
        demo.release()
        demo.toggle_pause()
        demo.hand.selected = 0
        demo.move_selection(1, 0, (1.0, 0.0, 0.0))
        demo.press_key()
        run(demo, 0.1)
        demo.release()
        moving = demo.world.state().velocity[CROWD.body == 0]
        assert moving[:, 0].min() > 0.05 and demo.world.state().velocity[CROWD.body == 1].max() == 0
        demo.restart()
        demo.frame()
        assert demo.hand.held is None and np.abs(demo.world.state().velocity).max() < 1e-12  # goals, to rounding


def test_what_is_live_is_what_can_change() -> None:
    assert live_parts(SCENE) == ("gravity", "dt")  # bodies are not poked: no stage for it is compiled
    assert "poke" in live_parts(Scene({"grid": {"rows": 2, "columns": 2}}))


def test_what_cannot_get_a_stiffness_is_offered_none() -> None:
    """Nor takes it from whoever names it live: what changes nothing is refused with the reason."""
    grid = {"grid": {"rows": 2, "columns": 2}}
    pbd = Scene(grid | {"springs": {}, "method": {"solver": "pbd"}})
    rigid = Scene(grid | {"springs": {"compliance": 0.0}, "method": {"solver": "xpbd"}})
    assert not any("stiffness" in live_parts(scene) for scene in (Scene(grid), pbd, rigid))
    for scene, reason in ((pbd, "method.pbd_stiffness"), (Scene(grid), "has no such part")):
        with pytest.raises(SceneError, match=reason):
            FakeCloth(scene, Options(live=frozenset({"stiffness"}))).set("springs.stiffness", 20.0)
