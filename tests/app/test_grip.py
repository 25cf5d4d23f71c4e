"""The hand on a body, without a window: its force, who shares it, and bodies that come to the pointer and stay whole."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies_scenes import BAR, BRICK, bodies_scene
from fake_cloth import FakeCloth

from softlab.app.window.demo import Demo
from softlab.app.window.live import live_parts
from softlab.app.window.mouse_constraint import CALMING, GIVE, HAND, SLOWING, STEADY, MouseConstraint
from softlab.model.base.errors import SceneError
from softlab.model.core.simulation import Options
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.cluster_tables import matching_factors

SOFT = BAR | {"spin": [0.0, 0.0, 0.0], "cluster_stiffness": 4000.0}  # 24 particles, 3 clusters
HARD = BRICK | {"spin": [0.0, 0.0, 0.0], "origin": [0.0, 2.0, 0.0]}
SCENE = bodies_scene(bar=SOFT, brick=HARD)
BODY_SET = SCENE.body_set
DT = SCENE.method.dt


class Jellies(FakeCloth):
    """Clusters move particles to their goals (model/assets/clusters.py), in NumPy: a substep a step, nothing to
    compile."""

    def _run(self, steps: int) -> None:
        clusters, dt = self.scene.body_set.clusters, self.scene.method.dt
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
    return BODY_SET.clusters.mass @ simulation.state().velocity.astype(np.float64)


# ---------------------------------------------------------------------- the force


@pytest.mark.parametrize("particle", [0, len(BODY_SET.position) - 1])
def test_a_pull_gives_the_impulse_of_its_force_to_neighbours_of_the_same_body(particle: int) -> None:
    simulation = opened(SCENE)
    grip = MouseConstraint(simulation, particle)
    target = BODY_SET.position[particle] + (0.1, 0.2, 0.0)
    force = grip.force(simulation, BODY_SET.position[particle], target, (), DT)
    grip.pull(simulation, target, (), DT)
    np.testing.assert_allclose(momentum(simulation), DT * force, rtol=1e-12)
    moved = np.flatnonzero(simulation.state().velocity.any(axis=1))
    assert (BODY_SET.body[moved] == BODY_SET.body[particle]).all() and len(moved) > 4
    speed = np.linalg.norm(simulation.state().velocity[moved], axis=1)
    away = np.linalg.norm(BODY_SET.position[moved] - BODY_SET.position[particle], axis=1)
    assert moved[np.argmax(speed)] == particle and (np.diff(speed[np.argsort(away)]) <= 1e-12).all()


def test_the_force_is_a_damped_spring_for_the_bodys_mass_and_carries_its_weight() -> None:
    simulation = opened(SCENE)
    brick = len(BODY_SET.position) - 1
    grip, place = MouseConstraint(simulation, brick), BODY_SET.position[brick]
    mass = BODY_SET.clusters.mass[BODY_SET.body == 1].sum()
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
    grip = MouseConstraint(opened(SCENE), 0)
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
        own = np.flatnonzero(BODY_SET.body == number)
        particle = int(own[0])  # at an end
        target = demo.positions[0][particle] + np.array([0.5, 1.0, -0.3])
        assert demo.take(particle, target) and "selected" in demo.message
        before = demo.positions[0][~np.isin(np.arange(len(BODY_SET.body)), own)]
        run(demo, 6.0)  # 60 times 1 / HAND, 18 times 1 / CALMING
        held = demo.positions[0][particle]
        # it hangs where it is held, but for what its weight moves it while a force is not renewed, g h^2 / 2
        grip, hold = demo.picker._constraint, steps * DT
        assert grip is not None and not demo.frozen
        near = 9.81 * hold**2 / 2
        assert np.linalg.norm(held - target) < near
        away = target - held
        expected = (
            grip.stiffness(hold) * away[1] / (9.81 * grip.mass) + 1
        )  # its weight, and what is missing to the pointer
        damper = SLOWING * grip._part / 2 / grip.mass  # at the speed of a fall for half of a hold, g h / 2
        assert demo.force()[1] / (9.81 * grip.mass) == pytest.approx(expected, abs=damper)
        clusters, now = BODY_SET.clusters, demo.world.read("position")[own]
        between, at_rest = (np.linalg.norm(p[:, None] - p, axis=2) for p in (now, BODY_SET.position[own]))
        # a soft one is drawn out by no more than the hand may let it give way, a rigid one by nothing
        assert (between - at_rest).max() < (1e-3 if number else GIVE) * grip.extent
        others = demo.positions[0][~np.isin(np.arange(len(BODY_SET.body)), own)]
        count = round(6.0 / hold) * steps
        np.testing.assert_allclose(others.mean(axis=0)[1] - before.mean(axis=0)[1], fall(count), rtol=1e-3)  # on and on
        demo.release()
        assert demo.force() == (0.0, 0.0, 0.0)
        m = clusters.mass[own] / clusters.mass[own].sum()
        start, velocity = m @ demo.positions[0][own], m @ demo.world.state().velocity[own]
        run(demo, 0.4)
        count = round(0.4 / hold) * steps
        moved = m @ demo.positions[0][own] - start
        np.testing.assert_allclose(moved, count * DT * velocity + [0.0, fall(count), 0.0], atol=1e-6)
        assert CALMING * DT * steps < SLOWING  # else the hand would have been less calming than told


def fall(steps: int) -> float:
    """How far a body falls in so many steps of semi-implicit Euler [m]."""
    return -9.81 * DT**2 * steps * (steps + 1) / 2


def test_the_hand_is_as_strong_as_the_manual_says() -> None:
    """docs/demo.md tells these numbers; whoever tunes one tells it there, too."""
    told = (Path(__file__).parents[2] / "docs" / "demo.md").read_text(encoding="utf-8")
    assert (HAND, GIVE, CALMING, STEADY, SLOWING) == (10.0, 0.1, 3.0, 0.2, 0.5)
    assert "(10/s)" in told and "a tenth of the body's length" in " ".join(told.split())


@pytest.mark.parametrize("particle", [0, 7, len(BODY_SET.position) - 1])
def test_a_pull_is_shared_by_mass_and_distance(particle: int) -> None:
    """By (1 - d^2 / r^2)^2, r half of the body's longest side, or two and a half spacings where that is more; what it moves
    before the rest of the body helps it is the mass whose velocity, as the hand sees it, is F / m."""
    body_set, grip = BODY_SET, MouseConstraint(opened(SCENE), particle)
    own = np.flatnonzero(body_set.body == body_set.body[particle])
    rest, mass = body_set.position[own], body_set.clusters.mass[own]
    longest, spacing = np.ptp(rest, axis=0).max(), body_set.copies[body_set.body[particle]].baked.spacing
    away = np.linalg.norm(rest - body_set.position[particle], axis=1) / max(longest / 2, 2.5 * spacing)
    expected = np.where(away < 1, mass * (1 - away**2) ** 2, 0)
    expected /= expected.sum()
    share = np.zeros(len(body_set.position))
    share[grip.particles] = grip.weights
    np.testing.assert_allclose(share[own], expected, atol=1e-15)
    assert grip.extent == pytest.approx(longest) and grip.mass == pytest.approx(mass.sum())
    simulation = opened(SCENE)
    grip.pull(simulation, None, (1.0, 0.0, 0.0), DT)
    seen = share[own] @ simulation.state().velocity[own]
    force = grip.force(simulation, body_set.position[particle], None, (1.0, 0.0, 0.0), DT)
    np.testing.assert_allclose(seen, DT * force / grip._part)


def test_a_paused_body_is_not_pushed_and_enter_pushes_the_whole_body() -> None:
    weightless = bodies_scene(bar=SOFT, brick=HARD, gravity=0.0)
    with Demo([weightless], precision="float64", open_world=opened) as demo:
        demo.toggle_pause()
        demo.take(0, BODY_SET.position[0] + (0.0, 1.0, 0.0))
        for _ in range(3):
            demo.drag(*(BODY_SET.position[0] + (0.0, 2.0, 0.0)))
            demo.frame()
        assert not demo.world.state().velocity.any() and demo.force()[1] > 0
        demo.release()
        demo.toggle_pause()
        demo.picker.selected = 0
        demo.move_selection(1, 0, (1.0, 0.0, 0.0))
        demo.press_key()
        run(demo, 0.1)
        demo.release()
        moving = demo.world.state().velocity[BODY_SET.body == 0]
        assert moving[:, 0].min() > 0.05 and demo.world.state().velocity[BODY_SET.body == 1].max() == 0
        demo.restart()
        demo.frame()
        assert demo.picker.poke is None and np.abs(demo.world.state().velocity).max() < 1e-12  # goals, to rounding


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
