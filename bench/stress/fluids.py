"""Laws of the hard cases of fluids, F1 to F9.

bench/stress/trial.py defines the result of a law; bench/stress/fluid_cases.py has the scenes; model/fluid/plan.py has
the stages of a step; docs/method/cases.md names the rows.
"""

from __future__ import annotations

import numpy as np

from softlab.bench.stress.trial import Check, Trial
from softlab.model.core.state import State
from softlab.model.fluid.measure import compression, differences
from softlab.model.fluid.parameters import MAX_NEIGHBOURS, speed_limit
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Box, Plane

SECONDS = 1.0  # simulated time of a cup's motion, and of fluids that fall and come to rest
SPARSE = 2.0  # s: simulated time of free flight
SETTLED = 5.0  # s: simulated time of two fluids that change places
FREE = 0.5  # s: a lone particle has not reached its floor by then
SCATTERED = 1.0  # m/s: standard deviation of random velocities
INSIDE = (0.4, 0.4, 0.3)  # m: inner size of the cup
STILL = 1e-5  # relative: of momentum, and of a rest distance
DENSE = 0.01  # largest mean excess over the rest density (section F of the lab's collection)
DEPTH = 0.1  # fraction of a heavy fluid's depth
MIN_ARRIVAL_SPEED = 0.99  # fraction of a speed that must remain

# names of the numbers
OUTSIDE, LAG = "farthest out of the cup", "mean velocity off the cup's, of it"
FALL, HEIGHT, SPEED = "place off the fall's law, of the way", "height over the floor, of a rest distance", "speed"
APART, LOST = "distance of the two, of a rest distance", "momentum lost"
LOWER, HIGH, PRESSED = "heavy fluid's height under the light one's", "heavy height off its rest", "mean compression"
ARRIVAL_SPEED, ENERGY, BELOW = "speed kept before it hits", "largest energy over the start's", "deepest below the floor"
FASTEST = "largest speed over its limit"
THROUGH, DRIFT, STIRRED = (
    "particles beyond the plate",
    "drift of the centre, of a rest distance",
    "largest way of a particle",
)
REPORTED, MISSED = "neighbours told as lost, off what NumPy counts", "neighbours lost"


def _unit(trial: Trial, size: float) -> float:
    """Return the unit in the last place of a number of this size."""
    return float(np.spacing(np.float32(size) if trial.single else np.float64(size)))


def _rounded(trial: Trial, size: float, seconds: float, mean: int = 0) -> float:
    """Rounding error [m/s] of a velocity after `seconds`, with coordinates as large as `size` [m].

    A velocity is a difference of two coordinates over a substep: half a unit in the last place of each, in every
    substep, in the worst case all of one sign. For the mean over `mean` particles (1 or more) the errors have either
    sign: the root of their number, four standard deviations.
    """
    method = trial.scene.method
    h = trial.dt / method.substeps
    substeps = trial.steps(seconds) * method.substeps
    return (4 * np.sqrt(substeps / mean) if mean else substeps) * _unit(trial, size) / h


def _limit(scene: Scene) -> float:
    return max(speed_limit(scene, part) for part in scene.fluids.values())


def _largest_speed(state: State) -> float:
    return float(np.linalg.norm(state.velocity.astype(np.float64), axis=1).max())


def _within_limit(trial: Trial, fastest: float) -> Check:
    """Check that no speed exceeds half a support radius per substep, except for rounding: walls rely on it."""
    return Check(FASTEST, fastest / _limit(trial.scene), "", "<", 1 + 8 * _unit(trial, 1.0))


def stays_in_its_cup(trial: Trial) -> list[Check]:
    """F1: a closed cup with thick walls that moves as a whole from the first step, and water at rest in it.

    Nothing may leave the cup, and after a second the water moves with it, except for its sloshing (Galileo).
    """
    velocity = np.array(next(part.velocity for kind, part in trial.scene.colliders if kind == "box"))
    farthest = 0.0
    for state in trial.watch(range(1, trial.steps(SECONDS) + 1)):
        place = state.position.astype(np.float64) - velocity * state.time
        farthest = max(farthest, float(np.maximum(-place, place - np.array(INSIDE)).max()))
    lag = np.linalg.norm(state.velocity.astype(np.float64).mean(axis=0) - velocity) / np.linalg.norm(velocity)
    # outside means beyond its faces, in front of which the thickness of a collider lies
    return [Check(OUTSIDE, farthest, "m", "<", 1e-3), Check(LAG, float(lag), "", "<", 0.1)]


def falls_alone(trial: Trial) -> list[Check]:
    """F2: a particle without neighbours is a point: x = x_0 - g h^2 n (n + 1) / 2 after n substeps (symplectic Euler).

    Then it lies on the floor, where only a wall's density supports it, nearer than half a rest distance.
    """
    scene, method = trial.scene, trial.scene.method
    assert scene.gravity is not None
    start, g, h = float(scene.fluid_set.position[0, 1]), scene.gravity.acceleration, trial.dt / method.substeps
    fallen, landed = trial.watch((trial.steps(FREE), trial.steps(4 * SECONDS)))
    n = trial.steps(FREE) * method.substeps
    fall = g * h * h * n * (n + 1) / 2
    error = abs(start - float(fallen.position[0, 1]) - fall) / fall
    rounded = _rounded(trial, start, FREE) * FREE / fall
    high = (float(landed.position[0, 1]) - _floor(scene)) / scene.fluid_set.spacing
    return [
        Check(FALL, error, "", "<", rounded),
        Check(HEIGHT, high, "", "<", 0.5),
        Check(BELOW, -high * scene.fluid_set.spacing, "m", "<", 8 * _unit(trial, 1.0)),
        Check(SPEED, _largest_speed(landed), "m/s", "<", _rounded(trial, 0.1, trial.dt)),
    ]


def parts_from_its_double(trial: Trial) -> list[Check]:
    """F3: inside a block, without weight, two particles coincide, so that no direction separates them.

    They separate (by the formula `apart`), momentum is conserved, and no speed exceeds the limit.
    """
    scene = trial.scene
    position = scene.fluid_set.position.copy()
    middle = int(np.argmin(np.linalg.norm(position - position.mean(axis=0), axis=1)))
    position[0] = position[middle]
    fastest, limit = 0.0, trial.steps(SECONDS)
    for state in trial.watch(range(1, limit + 1), trial.start(position)):
        fastest = max(fastest, _largest_speed(state))
    away = np.linalg.norm(state.position[0].astype(np.float64) - state.position[middle]) / scene.fluid_set.spacing
    return [
        Check(APART, float(away), "", ">", 0.5),
        _momentum(trial, state, np.zeros_like(position), SCATTERED, SECONDS),
        _within_limit(trial, fastest),
    ]


def two_alone(trial: Trial) -> list[Check]:
    """F3: two coincident particles alone.

    They may separate, since the kernel is steep at its centre, but their mean stays (no weight), and no division by
    their distance of 0 may show.
    """
    position = np.zeros_like(trial.scene.fluid_set.position)
    state = trial.run(trial.start(position), SECONDS)
    return [
        Check(SPEED, float(np.abs(state.velocity.mean(axis=0)).max()), "m/s", "<", _rounded(trial, 1.0, trial.dt)),
        Check(STIRRED, float(np.abs(state.position.mean(axis=0)).max()), "m", "<", _unit(trial, 8.0)),
    ]


def changes_places(trial: Trial) -> list[Check]:
    """F4: a fluid of 1000 kg/m^3 over one of 1 kg/m^3, in a tank: the heavier ends below (Archimedes).

    It ends at its own depth, and neither is compressed: the mean density over all is within 1 % (section F). The light
    fluid is thrown about by one of a thousand times its density: its speed is reported, and bounded by the limit.
    """
    scene = trial.scene
    fluid = scene.fluid_set.fluid
    heights, fastest = [], 0.0
    for state in trial.watch(range(60, trial.steps(SETTLED) + 1, 60)):
        heights.append([float(state.position[fluid == kind, 1].astype(np.float64).mean()) for kind in (0, 1)])
        fastest = max(fastest, _largest_speed(state))
    (heavy, light), depth = (
        heights[-1],
        float(np.ptp(scene.fluid_set.position[fluid == 0, 1])) + scene.fluid_set.spacing,
    )
    return [
        Check(LOWER, light - heavy, "m", ">", depth / 2),
        Check(HIGH, abs(heavy - depth / 2) / depth, "", "<", DEPTH),
        Check(PRESSED, compression(scene, state.position.astype(np.float64))[0], "", "<", DENSE),
        _within_limit(trial, fastest),
        Check("largest speed at the end", _largest_speed(state), "m/s"),
    ]


def hits_the_floor(trial: Trial) -> list[Check]:
    """F5: a slab that flies at a floor at 100 m/s.

    It arrives with that speed, nothing passes the floor, and the impact adds no energy. With too few substeps it
    arrives slower, since no speed exceeds half a support radius per substep.
    """
    scene = trial.scene
    initial_speed, floor = np.linalg.norm(next(iter(scene.fluids.values())).velocity), _floor(scene)
    arrival, energy, low, fastest = 0.0, 0.0, np.inf, 0.0
    for number, state in enumerate(trial.watch(range(1, trial.steps(SECONDS) + 1))):
        speed = np.linalg.norm(state.velocity.astype(np.float64), axis=1)
        arrival = float(speed.mean() / initial_speed) if number == 0 else arrival
        energy, fastest = max(energy, float((speed**2).mean() / initial_speed**2)), max(fastest, float(speed.max()))
        low = min(low, float(state.position[:, 1].astype(np.float64).min()))
    return [
        Check(ARRIVAL_SPEED, arrival, "", ">", MIN_ARRIVAL_SPEED),
        Check(ENERGY, energy, "", "<", 1 + float(_rounded(trial, 2.0, trial.dt) / initial_speed)),
        Check(BELOW, floor - low, "m", "<", 8 * _unit(trial, 1.0)),
        _within_limit(trial, fastest),
        Check("energy after it, of the start's", float((speed**2).mean() / initial_speed**2), ""),
    ]


def keeps_still(trial: Trial) -> list[Check]:
    """F6: a drop without weight. On the lattice by which its kernels are scaled nothing moves (A12).

    With cohesion or surface tension, forces in pairs, its centre stays.
    """
    scene = trial.scene
    begin = scene.fluid_set.position
    state = trial.run(None, SPARSE)
    displacement = state.position.astype(np.float64) - begin
    size, spacing = float(np.abs(begin).max()), scene.fluid_set.spacing
    one, all_of_them = (_rounded(trial, size, SPARSE, mean) * SPARSE / spacing for mean in (1, len(begin)))
    checks = [Check(DRIFT, float(np.abs(displacement.mean(axis=0)).max() / spacing), "", "<", max(STILL, all_of_them))]
    drawn = any(part.cohesion or part.surface_tension for part in scene.fluids.values())
    stirred = float(np.abs(displacement).max() / spacing)
    return [*checks, Check(STIRRED, stirred, "") if drawn else Check(STIRRED, stirred, "", "<", max(STILL, one))]


def keeps_momentum(trial: Trial) -> list[Check]:
    """F7: particles of one or two fluids with random initial velocities, without walls or weight.

    Momentum is conserved (Newton's third law) to 1e-5 of the sum of all m |v|; in float32 to the rounding of
    velocities.
    """
    fluid_set = trial.scene.fluid_set
    velocity = np.random.default_rng(7).normal(0, SCATTERED, fluid_set.position.shape)
    state = trial.run(trial.start(fluid_set.position, velocity), SPARSE)
    return [_momentum(trial, state, velocity, float(np.abs(velocity).mean()), SPARSE)]


def _momentum(trial: Trial, state: State, velocity: np.ndarray, speed: float, seconds: float) -> Check:
    """Check of the change of the total momentum, relative to the total mass times `speed` [m/s]."""
    m = trial.scene.fluid_set.masses
    change = m @ (state.velocity.astype(np.float64) - velocity)
    lost = float(np.abs(change).max() / (m.sum() * speed))
    rounded = _rounded(trial, float(np.abs(state.position).max()), seconds, len(m)) / speed
    return Check(LOST, lost, "", "<", max(STILL, rounded))


def stops_at_a_plate(trial: Trial) -> list[Check]:
    """F8: a block and a plate meet at almost the largest possible speed.

    However thin the plate, no particle passes through it, and none ends beyond it.
    """
    (plate,) = (part for kind, part in trial.scene.colliders if isinstance(part, Box))
    fastest, through = 0.0, 0
    for state in trial.watch(range(1, trial.steps(FREE) + 1)):
        middle = plate.center[1] + plate.velocity[1] * state.time
        through = max(through, int((state.position[:, 1] < middle).sum()))
        fastest = max(fastest, _largest_speed(state))
    return [Check(THROUGH, float(through), "", "<", 0.5), _within_limit(trial, fastest)]


def reports_lost_neighbours(trial: Trial) -> list[Check]:
    """F9: several blocks in one place, slightly perturbed: more neighbours than the lists can store.

    In the first substep the reported number of lost neighbours equals the number beyond the lists' length that NumPy
    counts over all pairs; the rest stays finite and within its limit.
    """
    scene = trial.scene
    random = np.random.default_rng(9)
    position = scene.fluid_set.position + random.normal(0, scene.fluid_set.spacing / 20, scene.fluid_set.position.shape)
    if trial.single:
        position = position.astype(np.float32).astype(np.float64)
    neighbours = np.bincount(differences(scene, position)[0].ravel(), minlength=len(position))
    expected = int(np.maximum(neighbours - MAX_NEIGHBOURS[scene.dimensions], 0).sum())
    once = scene.replace({"method.substeps": 1, "method.dt": trial.dt / scene.method.substeps})
    with trial.open(trial.start(position), scene=once) as simulation:
        trial.advance(simulation, 1)
        reported = int(simulation.read("neighbours_lost"))
    fastest = max(
        _largest_speed(state) for state in trial.watch(range(1, trial.steps(FREE) + 1), trial.start(position))
    )
    # in float32 a pair within rounding of the support radius may be counted by only one of the two
    return [
        Check(REPORTED, abs(reported / max(expected, 1) - 1), "", "<", 1e-3 if trial.single else 1e-12),
        Check(MISSED, float(reported), "", ">", 0.5),
        _within_limit(trial, fastest),
    ]


def _floor(scene: Scene) -> float:
    """Height [m] of the floor's surface, including its thickness."""
    return next(part.point[1] + part.thickness for _, part in scene.colliders if isinstance(part, Plane))
