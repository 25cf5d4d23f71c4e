"""Hard cases of soft and rigid bodies: spin and momenta in free flight, squashed and inside out, shot at walls at 100 m/s,
begun inside each other. bench/stress/trial.py tells what a law returns; bench/stress/body_cases.py gives these their scenes.

A bound follows from the step: from what a formula loses, or from roundings. A substep rounds a place eight times or so,
always the same way of what moves alike, and a rounding over h is a velocity, which stays. A rotation is not touched while it
is within KEPT of the nearest one (model/formulas/rotation.py), so that each substep may lag behind by LAG.
"""

from __future__ import annotations

from math import atan, cos, sin

import numpy as np

from bench.experiments import body_laws
from bench.experiments.body_laws import FRAME, SPIN, angular_momentum, spin_left
from bench.experiments.body_scenes import (
    CHANGED,
    GRAVITY,
    RIGID_SPACING,
    SEPARATION,
    SPACING,
    ULP,
    centre,
    changed,
    kinetic,
    masses,
    nearest,
    out_of_shape,
)
from bench.stress.laws import Law
from bench.stress.trial import Check, Trial
from model.core.simulation import State
from model.formulas.rotation import KEPT
from model.scene.cloth import Box, Plane, Sphere
from model.scene.scene import Scene

ROUNDINGS = 8  # of a place in a substep
GOALS = 32  # roundings of 1 m: what a goal is wrong by, of some 60 operations on half a metre
LAG = 2 * KEPT  # roundings of 1: the angle [rad] that a turn may lag behind, |b| over s1 + s2 > 1
FLYING, LOOKS = 20, 50  # steps that a shot, or a body that was squashed, is looked at one by one
LAST = 1000  # steps: 10 s, then it must have come to rest

# names of numbers that the lab book tells of
OFF_LAW, SPIN_KEPT, OFF_NEWTON = "spin, off what its law keeps", "spin kept", "error against Newton's law"
OUT_OF_SHAPE, PARTING = "out of shape over the spacing", "speed of parting"


def of_a_place(trial: Trial, size: float = 1.0) -> float:
    """What ROUNDINGS of a place of `size` [m] come to."""
    return ROUNDINGS * ULP[trial.precision] * size


def substep(scene: Scene) -> float:
    """h [s]"""
    return scene.method.dt / scene.method.substeps


# ---------------------------------------------------------------------- A8 and S7: spin and flight


def law_turn(substeps: int) -> float:
    """[rad]: how far the law of spin turns a body within its time."""
    h = FRAME / substeps
    angle = atan(body_laws.SPEED * h)
    total = angle
    for _ in range(substeps * round(body_laws.SECONDS[SPIN] / FRAME) - 1):
        angle = atan(sin(angle))
        total += angle
    return total


def spins(trial: Trial) -> list[Check]:
    """A8 and S7: a rigid body, one cluster, at 2 pi rad/s for 2 s. A substep takes its angle D to atan(sin D), the first
    being atan(omega h): N substeps that lag by LAG each lose that over the first D of the spin, and N of it, N / 2
    substeps each, of the way. Beside the law, how far the body is from where Newton has it: two whole turns, which is where
    it was."""
    scene = trial.scene
    state = trial.run(None, body_laws.SECONDS[SPIN])
    m, at, n = masses(scene)[:, 0], scene.body_set.position, scene.method.substeps
    before = angular_momentum(at, scene.body_set.velocity, m)
    left = float(np.linalg.norm(angular_momentum(*_moving(state), m)) / np.linalg.norm(before))
    middle, turn = centre(scene, at), law_turn(n)
    rotation = np.array([[cos(turn), -sin(turn), 0], [sin(turn), cos(turn), 0], [0, 0, 1]])
    lag, steps = LAG * ULP[trial.precision], n * trial.steps(body_laws.SECONDS[SPIN])
    reach = float(np.linalg.norm(at - middle, axis=1).max()) / scene.body_set.spacing

    def error(expected: np.ndarray) -> float:
        return float(np.sqrt(np.mean(np.sum((_moving(state)[0] - expected) ** 2, axis=1)))) / scene.body_set.spacing

    return [
        Check(OFF_LAW, abs(left - spin_left(n)), "", "<", steps * lag / atan(_first(n))),
        Check("error against the law", error((at - middle) @ rotation.T + middle), "spacing", "<",
              reach * lag * steps**2 / 2),
        Check(OFF_NEWTON, error(at), "spacing"),
        Check(SPIN_KEPT, left, ""),
    ]  # fmt: skip


def _first(substeps: int) -> float:
    return body_laws.SPEED * FRAME / substeps


def flies(trial: Trial) -> list[Check]:
    """A8: a soft body is thrown, spinning. Masses that are split among clusters keep linear momentum to rounding: places of
    up to 20 m. Of the angular one its law takes w^2 h t at most, as of a rigid body (1 - 1 / sqrt(1 + 2 w^2 h t) is less)."""
    scene, seconds = trial.scene, body_laws.SECONDS[body_laws.FLIGHT]
    state = trial.run(None, seconds)
    m, h = masses(scene)[:, 0], substep(scene)
    at, velocity = _moving(state)
    fallen = np.array([0.0, GRAVITY * seconds, 0.0])
    off = np.abs(centre(scene, velocity - scene.body_set.velocity) + fallen).max()
    spin = np.linalg.norm(angular_momentum(at, velocity, m))
    lost = 1 - float(spin / np.linalg.norm(angular_momentum(scene.body_set.position, scene.body_set.velocity, m)))
    steps = scene.method.substeps * trial.steps(seconds)
    return [
        Check("speed, off what gravity gives", float(off), "m/s", "<", steps * of_a_place(trial, 20.0) / h),
        Check("angular momentum lost", lost, "", "<", body_laws.SPEED**2 * h * seconds),
    ]


def _moving(state: State) -> tuple[np.ndarray, np.ndarray]:
    """(position [m], velocity [m/s]) in float64."""
    return state.position.astype(np.float64), state.velocity.astype(np.float64)


# ---------------------------------------------------------------------- squashed, and inside out


def finds_its_shape(how: str) -> Law:
    """A10: a soft body, squashed or mirrored as CHANGED says and let go, swings about its shape, and what a step takes away
    brings it there: one caught in another shape, twisted or inside out, would have particles half a spacing off. It never
    has more energy than was put in, and what overlaps inside it was given, a speed of separation a particle. Its momentum
    stays 0, but for rounding."""

    def law(trial: Trial) -> list[Check]:
        scene = trial.scene
        begin = changed(scene, CHANGED[how])
        given = scene.body_set.clusters.energy(begin.position) + masses(scene).sum() * SEPARATION**2 / 2
        most = 0.0
        for state in trial.watch((*range(1, LOOKS + 1), LAST), begin):
            if state.step <= LOOKS:
                most = max(most, kinetic(scene, state.velocity))
        at, velocity = _moving(state)
        drift = float(np.abs(centre(scene, velocity)).max())
        rounded = LAST * scene.method.substeps * of_a_place(trial) / substep(scene)
        return [
            Check(OUT_OF_SHAPE, out_of_shape(scene, at) / SPACING, "", "<", 0.01),
            Check("largest kinetic energy over what was put in", most / given, "", "<", 1.0),
            Check("speed of its centre", drift, "m/s", "<", rounded),
        ]

    return law


def is_whole_at_once(trial: Trial) -> list[Check]:
    """A10: a rigid body, whatever was done to it, is whole after one substep, as any rotation is one, and the next one takes
    the way back out of the velocities: both to what goals are wrong by."""
    scene, worst, fastest, moved = trial.scene, 0.0, 0.0, 0.0
    at_rest = centre(scene, scene.body_set.position)
    for change in CHANGED.values():
        for state in trial.watch((1, 3), changed(scene, change)):
            at, velocity = _moving(state)
            worst = max(worst, out_of_shape(scene, at))
        fastest = max(fastest, float(np.abs(velocity).max()))
        moved = max(moved, float(np.abs(centre(scene, at) - at_rest).max()))
    goal = GOALS * ULP[trial.precision]
    return [
        Check(f"out of shape, worst of {len(CHANGED)} ways", worst, "m", "<", goal),
        Check("speed after three substeps", fastest, "m/s", "<", 3 * goal / substep(scene)),
        Check("way of its centre", moved, "m", "<", 6 * goal),
    ]


# ---------------------------------------------------------------------- shot at 100 m/s


def is_stopped_by_a_plane(trial: Trial) -> list[Check]:
    """B16: a half-space holds at any speed, as nothing is behind it. Its answer takes energy away, and what of a rigid body
    was pushed out of it alone turns and lifts it, from the speed that it had. Then it finds its shape, to a tenth of a
    spacing."""
    scene, lowest, peak = trial.scene, np.inf, 0.0
    energy = kinetic(scene, scene.body_set.velocity)
    reach = next(part for part in scene.parts.values() if isinstance(part, Plane)).thickness
    for state in trial.watch((*range(1, FLYING + 1), FLYING + LAST)):
        lowest = min(lowest, float(state.position[:, 1].min()))
        if state.step <= FLYING:
            peak = max(peak, kinetic(scene, state.velocity))
    bent = out_of_shape(scene, _moving(state)[0]) / scene.body_set.spacing
    return [
        Check("deepest under the plane's reach", reach - lowest, "m", "<", 4 * ULP[trial.precision]),
        Check("kinetic energy over the shot's", peak / energy, "", "<", 1 + of_a_place(trial)),
        Check("out of shape over the spacing, 10 s later", bent, "", "<", 0.1),
    ]


def is_stopped_by_a_box(trial: Trial) -> list[Check]:
    """B16: a box is not swept; what is inside leaves by the nearest face. So it stops what goes less than half its thickness
    a substep, and takes energy away."""
    scene = trial.scene
    box = next(part for part in scene.parts.values() if isinstance(part, Box))
    top, way = box.center[1] + box.half_size[1] + box.thickness, np.abs(scene.body_set.velocity).max() * substep(scene)
    lowest = np.inf
    for state in trial.watch(range(1, FLYING + 1)):
        lowest = min(lowest, float(state.position[:, 1].min()))
    energy = kinetic(scene, state.velocity) / kinetic(scene, scene.body_set.velocity)
    return [
        Check("deepest under the reach of its upper side", top - lowest, "m", "<", 4 * ULP[trial.precision]),
        Check("kinetic energy over the shot's", energy, "", "<", 1.0),
        Check("way a substep over its thickness", way / (2 * box.half_size[1]), ""),
    ]


def is_stopped_by_a_body(trial: Trial) -> list[Check]:
    """B16: what goes an eighth of the distance that particles keep a substep comes neither through another body, two layers
    of particles, nor is it caught in it. Momentum is kept but for roundings of places of 1 m; energy is only taken away, a
    tenth of it at least."""
    scene, steps = trial.scene, round(0.04 / trial.dt)
    energy, most, least = kinetic(scene, scene.body_set.velocity), 0.0, np.inf
    for look in trial.watch(range(steps // FLYING, steps + 1, steps // FLYING)):
        at, velocity = _moving(look)
        most = max(most, kinetic(scene, velocity))
        least = min(least, float(centre(scene, at, 1)[1] - centre(scene, at, 0)[1]))
    names = [copy.name for copy in scene.body_set.copies]
    keep = (getattr(scene.parts[names[1]], "particle_spacing") + RIGID_SPACING) / 2  # noqa: B009 - of either kind
    change = np.abs(centre(scene, velocity - scene.body_set.velocity)).max()
    return [
        Check("least height of its centre over the other's", least, "m", ">", RIGID_SPACING),
        Check("nearest particles at last over their distance", nearest(scene, at) / keep, "", ">", 0.9),
        Check("kinetic energy at last over the shot's", kinetic(scene, velocity) / energy, "", "<", 0.9),
        Check("kinetic energy ever gained over the shot's", most / energy - 1, "", "<", of_a_place(trial, steps)),
        Check("speed of the centre of both, off what it was", float(change), "m/s", "<",
              steps * of_a_place(trial) / substep(scene)),
    ]  # fmt: skip


# ---------------------------------------------------------------------- B17: inside each other at the start


def is_let_go_slowly(trial: Trial) -> list[Check]:
    """B17: contacts lead particles apart at v, the speed of separation. The rest of the body follows as a mass on a spring
    whose end moves: y = v t - v sin(w t) / w, at 2 v at most, whatever w. So two bodies part at 2 v at most, with an energy
    of 2 mu v^2, mu = m M / (m + M): of bodies alike m v^2 / 2 a particle, as the row asks."""
    scene, parting, most = trial.scene, 0.0, 0.0
    m, M = (masses(scene)[scene.body_set.body == body].sum() for body in (0, 1))
    for state in trial.watch((*range(1, 61), 100)):
        at, velocity = _moving(state)
        if state.step <= 60:
            most = max(most, kinetic(scene, velocity))
            apart = centre(scene, velocity, 0) - centre(scene, velocity, 1)
            parting = max(parting, float(np.linalg.norm(apart)))
    allowed = 2 * m * M / (m + M) * SEPARATION**2
    return [
        Check("energy gained over what parting allows", most / allowed, "", "<", 1.0),
        Check(PARTING, parting, "m/s", "<", 2 * SEPARATION),
        Check(OUT_OF_SHAPE, out_of_shape(scene, at) / scene.body_set.spacing, "", "<", 1.0),
        Check("nearest particles after 1 s over their distance", nearest(scene, at) / scene.body_set.spacing, ""),
    ]


def parts(trial: Trial) -> list[Check]:
    """B17: the same, of what is not deeper than half a body: then they have parted after a second, to the distance that
    particles keep. (What lies deeper may stay caught, since particles do not know an inside.)"""
    *judged, apart = is_let_go_slowly(trial)
    return [*judged, Check(apart.name, apart.value, apart.unit, ">", 1 - 1e-5)]


def is_pushed_out_in_place(trial: Trial) -> list[Check]:
    """B17: a collider puts particles on its surface within a step, and no speed comes from the depth d. What the clusters
    then hold is what their ways out have bent them by, w^2 m d^2 / 2 each, and there never is more than that."""
    scene = trial.scene
    ball = next(part for part in scene.parts.values() if isinstance(part, Sphere))
    middle, reach, clusters = np.array(ball.center), ball.radius + ball.thickness, scene.body_set.clusters
    depths = np.maximum(reach - np.linalg.norm(scene.body_set.position - middle, axis=1), 0)
    given = clusters.stiffness[0] / 2 * float((clusters.mass * depths**2).sum())
    most, deepest = 0.0, -np.inf
    for state in trial.watch(range(1, 101)):
        at, velocity = _moving(state)
        deepest = max(deepest, reach - float(np.linalg.norm(at - middle, axis=1).min()))
        most = max(most, kinetic(scene, velocity) + clusters.energy(at))
    return [
        Check("energy over what its ways out bend it by", most / given, "", "<", 1.0),
        Check("deepest particle inside the ball", deepest, "m", "<", of_a_place(trial)),
        Check("energy left over it", kinetic(scene, velocity) / given, "", ">", 0.1),
        Check("deepest at the start", float(depths.max()), "m"),
    ]
