"""Bodies under load and at rest: stacks, heaps, and what was dropped.

Depths follow from the weight above and from what one projection moves: the laws of `softlab hard` (bench/stress/piles.py),
here with more variants; what the method cannot do is written where it is met.
"""

from __future__ import annotations

import numpy as np
import pytest
from bodies_scenes import checks_of, end_state, holds, opened

from softlab.bench.experiments.body_scenes import (
    FALL,
    GRAVITY,
    SEPARATION,
    SPACING,
    centre,
    heap,
    kinetic,
    load,
    masses,
    nearest,
    out_of_shape,
    stack,
    sunk,
)
from softlab.bench.stress.piles import LOWERED, bears, heaps_up, lies_still, stands
from softlab.cpu_backend.contact.particles_project import make_settle_stage
from softlab.model.contact.particle_parameters import H_ASLEEP, H_FASTEST, PAIRS
from softlab.model.scene.scene import load_scene

BOTH = pytest.mark.parametrize("precision", ["float64", "float32"])

# ---------------------------------------------------------------------- stacks


@pytest.mark.parametrize("substeps,sweeps", [(4, 1), (4, 3), (8, 1)])
def test_ten_bricks_stand_as_deep_as_the_weight_above_says(substeps: int, sweeps: int) -> None:
    """Sweeps add nothing where each particle has one contact. The top comes down by 199 g h^2, 5 % of a brick with 4
    substeps, 1.2 % with 8."""
    checks = {check.name: check for check in checks_of(stands, stack(substeps, contact={"sweeps": sweeps}))}
    assert all(check.good for check in checks.values())
    assert checks[LOWERED].value < 0.05 * (4 / substeps) ** 2


@BOTH
@pytest.mark.parametrize("ratio,substeps", [(10.0, 4), (100.0, 16)])
def test_a_brick_bears_a_heavy_one(ratio: float, substeps: int, precision: str) -> None:
    holds(bears, load(ratio, substeps), precision)


def test_iterations_make_a_stack_stiffer() -> None:
    """n of them share the weight: at the top each interface gives 4 k g h^2 / n; all together less than half with two, and
    less than a third with four."""
    scenes = [stack(4, iterations) for iterations in (1, 2, 4)]
    found = [sunk(scene, end_state(scene, steps=1000).position) for scene in scenes]
    for iterations, depths in zip((1, 2, 4), found, strict=True):
        assert depths[:-5:-1] == pytest.approx(np.array([4, 8, 12, 16]) / iterations, abs=0.02)
    total = [depths.sum() for depths in found]
    assert total[1] < total[0] * 0.6 and total[2] < total[0] / 3


def test_a_stack_sleeps_in_float32() -> None:
    """Friction takes back how a body slid in a substep, and forgets: rounding, always the same way, moves a stack that is
    awake by 2 mm in 10 s. Asleep it has no speed at all, and stays."""
    scene = stack(4, contact={"sleeping_speed": 0.005})
    with opened(scene, precision="float32") as simulation:
        simulation.advance(600)
        early = simulation.state()
        simulation.advance(400)
        late = simulation.state()
    assert not early.velocity.any() and np.array_equal(early.position, late.position)
    assert np.abs(late.position - scene.body_set.position)[:, [0, 2]].max() < 0.001
    assert centre(scene, scene.body_set.position - late.position, 9)[1] < 0.06 * 0.25


def test_the_catalogues_stack_stands_for_ten_seconds() -> None:
    """Five layers of two, across each other: eight contacts of 32 particles to an interface and 2 iterations, 4 k g h^2 each
    as above; under 10 + 40 of them in all, 1 % of a beam, and no lean."""
    scene = load_scene("rigid-stack")
    with opened(scene, precision="float32", live=()) as simulation:
        simulation.advance(600)
        state = simulation.state()
    moved = state.position - scene.body_set.position
    assert -moved[:, 1].min() < 50 * GRAVITY / 480**2 < 0.01 * 0.25
    assert np.abs(moved[:, [0, 2]]).max() < 1e-4 and not state.velocity.any()


@pytest.mark.parametrize("parts", [{"sleeping"}, {"speed-limit"}, {"sleeping", "speed-limit"}])
@pytest.mark.parametrize("real", [np.float64, np.float32])
def test_travels_go_along_with_what_sleeps_or_is_limited(parts: set[str], real: type) -> None:
    """A particle of a rigid body that is put back takes its momentum along. Travels that were cut by themselves gave a brick
    that settled on another one up to 0.74 of g h a substep."""
    random, count = np.random.default_rng(3), 64
    before, way = random.uniform(-1, 1, 3 * count), random.uniform(-0.01, 0.01, 3 * count)
    way[::4] = 0.0
    before, position = before.astype(real), (before + way).astype(real)
    travel = random.uniform(-0.01, 0.01, 4 * count).astype(real)
    at, had, record = position.copy(), travel.copy(), np.zeros(PAIRS, real)
    record[H_ASLEEP], record[H_FASTEST] = 0.006, 0.009
    make_settle_stage(real, "exact", frozenset(parts | {"rigid-motion"}))(2, count, before, position, record, travel)
    moved = position - at
    assert np.count_nonzero(moved) >= 12
    assert np.array_equal(travel, had + np.append(moved, np.zeros(count, real)))


# ---------------------------------------------------------------------- rest, and B18: heaps


@BOTH
@pytest.mark.parametrize("copies,substeps", [(1, 1), (1, 4), (4, 4)])
def test_what_was_dropped_comes_to_rest(copies: int, substeps: int, precision: str) -> None:
    """From half a metre, alone and on each other."""
    holds(lies_still, heap(copies, substeps), precision)


def test_bodies_that_were_pressed_into_each_other_stay_caught() -> None:
    """What contacts between particles cannot do, as none of them knows where its body ends. Of an impact masses that are
    split leave an overlap, and the next substep takes it for one that was there, and lets it go at the speed of separation:
    slower than the fall, rows of particles come past each other, and lie between each other's for good, at less than half of
    their distance. They do not fly apart, but twitch, by some mm/s. So with one substep: with two, friction where they touch
    turns them off each other. At the speed of the fall and two they keep apart, and rest (after 20 s: one slides off the
    others late, at 15 s)."""
    scene = heap(4, 2)
    states = [end_state(heap(4, *how), steps=2000) for how in ((1, SEPARATION), (2, FALL))]
    caught, apart = (nearest(scene, state.position) for state in states)
    assert caught < SPACING / 2 and apart > 0.95 * SPACING
    drop = masses(scene).sum() * GRAVITY * 0.5
    energies = [kinetic(scene, state.velocity) for state in states]
    assert energies[0] < 1e-5 * drop and energies[1] < 1e-6 * drop
    assert out_of_shape(scene, states[0].position) < SPACING


@BOTH
def test_a_heap_of_eight_does_not_sink_into_itself(precision: str) -> None:
    holds(heaps_up, heap(8, 4), precision)
