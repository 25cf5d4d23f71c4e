"""Hard cases of soft and rigid bodies.

They are spin and momenta in free flight, deformed and inverted starts, impacts at 100 m/s, and bodies that start inside
each other. bench/stress/trial.py defines the result of a law; bench/stress/body_cases.py has the scenes. Bounds follow
from the step: from a formula of its loss, or from rounding. A substep rounds a coordinate about eight times, always in
the same direction for equal motion, and a rounding error over h is a velocity, which stays. A rotation within KEPT of
the nearest one is not changed (model/formulas/rotation.py), so each substep may lag behind by LAG.
"""

from __future__ import annotations

from math import atan, cos, sin

import numpy as np

from softlab.bench.experiments import body_laws
from softlab.bench.experiments.body_laws import FRAME, SPIN, angular_momentum, spin_left
from softlab.bench.experiments.body_scenes import (
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
from softlab.bench.stress.laws import Law
from softlab.bench.stress.trial import Check, Trial
from softlab.model.core.simulation import State
from softlab.model.formulas.rotation import UNCHANGED
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Box, Plane, Sphere

ROUNDINGS = 8  # rounding errors of a coordinate per substep
GOALS = 32  # rounding errors of 1 m: error of a goal, from some 60 operations on half a metre
LAG = 2 * UNCHANGED  # rounding errors of 1: the angle [rad] by which a rotation may lag behind, |b| over s1 + s2 > 1
FLYING, CHECKED_STEPS = 20, 50  # steps after an impact, or of a deformed body, that are checked one by one
LAST = 1000  # steps: 10 s, after which it must be at rest

# names of the numbers that the lab book quotes
OFF_LAW, SPIN_FRACTION, OFF_NEWTON = "spin, off what its law keeps", "spin kept", "error against Newton's law"
OUT_OF_SHAPE, PARTING = "out of shape over the spacing", "speed of parting"


def of_a_place(trial: Trial, size: float = 1.0) -> float:
    """Return ROUNDINGS rounding errors of a coordinate of `size` [m]."""
    return ROUNDINGS * ULP[trial.precision] * size


def substep(scene: Scene) -> float:
    """Length of a substep, h [s]."""
    return scene.method.dt / scene.method.substeps


# ---------------------------------------------------------------------- A8 and S7: spin and flight


def law_turn(substeps: int) -> float:
    """Return the angle [rad] by which a body rotates within its time by the law of spin."""
    h = FRAME / substeps
    angle = atan(body_laws.SPEED * h)
    total = angle
    for _ in range(substeps * round(body_laws.SECONDS[SPIN] / FRAME) - 1):
        angle = atan(sin(angle))
        total += angle
    return total


def spins(trial: Trial) -> list[Check]:
    """A8 and S7: a rigid body, one cluster, at 2 pi rad/s for 2 s.

    A substep takes its angle D to atan(sin D), the first being atan(omega h). N substeps that lag by LAG each lose that
    over the first D of the spin, and N of it, N / 2 substeps each, of the displacement. The distance of the body from
    Newton's law is reported too: two whole turns, i.e. its start."""
    scene = trial.scene
    state = trial.run(None, body_laws.SECONDS[SPIN])
    m, at, n = masses(scene)[:, 0], scene.body_set.position, scene.method.substeps
    before = angular_momentum(at, scene.body_set.velocity, m)
    left = float(np.linalg.norm(angular_momentum(*_moving(state), m)) / np.linalg.norm(before))
    middle, turn = centre(scene, at), law_turn(n)
    rotation = np.array([[cos(turn), -sin(turn), 0], [sin(turn), cos(turn), 0], [0, 0, 1]])
    lag, steps = LAG * ULP[trial.precision], n * trial.steps(body_laws.SECONDS[SPIN])
    radius = float(np.linalg.norm(at - middle, axis=1).max()) / scene.body_set.spacing

    def error(expected: np.ndarray) -> float:
        return float(np.sqrt(np.mean(np.sum((_moving(state)[0] - expected) ** 2, axis=1)))) / scene.body_set.spacing

    return [
        Check(OFF_LAW, abs(left - spin_left(n)), "", "<", steps * lag / atan(_first(n))),
        Check("error against the law", error((at - middle) @ rotation.T + middle), "spacing", "<",
              radius * lag * steps**2 / 2),
        Check(OFF_NEWTON, error(at), "spacing"),
        Check(SPIN_FRACTION, left, ""),
    ]  # fmt: skip


def _first(substeps: int) -> float:
    return body_laws.SPEED * FRAME / substeps


def flies(trial: Trial) -> list[Check]:
    """A8: a soft body is thrown with spin.

    Masses that are split among clusters conserve the linear momentum to rounding, with coordinates of up to 20 m. The
    angular momentum loses at most w^2 h t by its law, as for a rigid body (1 - 1 / sqrt(1 + 2 w^2 h t) is less)."""
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
    """Return (position [m], velocity [m/s]) in float64."""
    return state.position.astype(np.float64), state.velocity.astype(np.float64)


# ---------------------------------------------------------------------- deformed and inverted starts


def finds_its_shape(how: str) -> Law:
    """A10: a soft body, deformed as CHANGED says and released, vibrates about its shape until the step has damped it.

    A body stuck in another shape, twisted or inverted, would have particles half a spacing off. Its energy never
    exceeds the initial elastic energy plus that of the overlaps inside it, one separation speed per particle. Its
    momentum stays 0, except for rounding."""

    def law(trial: Trial) -> list[Check]:
        scene = trial.scene
        begin = changed(scene, CHANGED[how])
        input_energy = scene.body_set.clusters.energy(begin.position) + masses(scene).sum() * SEPARATION**2 / 2
        most = 0.0
        for state in trial.watch((*range(1, CHECKED_STEPS + 1), LAST), begin):
            if state.step <= CHECKED_STEPS:
                most = max(most, kinetic(scene, state.velocity))
        at, velocity = _moving(state)
        drift = float(np.abs(centre(scene, velocity)).max())
        rounded = LAST * scene.method.substeps * of_a_place(trial) / substep(scene)
        return [
            Check(OUT_OF_SHAPE, out_of_shape(scene, at) / SPACING, "", "<", 0.01),
            Check("largest kinetic energy over what was put in", most / input_energy, "", "<", 1.0),
            Check("speed of its centre", drift, "m/s", "<", rounded),
        ]

    return law


def is_whole_at_once(trial: Trial) -> list[Check]:
    """A10: a rigid body, however deformed, has its shape after one substep, since any rotation is one.

    The next substep removes the displacement from the velocities; both to the error of a goal."""
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


# ---------------------------------------------------------------------- impacts at 100 m/s


def is_stopped_by_a_plane(trial: Trial) -> list[Check]:
    """B16: a half-space stops a body at any speed, as nothing is behind it.

    Its response reduces the energy. A rigid body of which only a part was pushed out rotates and rises, with energy
    from its initial speed. Then it recovers its shape, to a tenth of a spacing."""
    scene, lowest, peak = trial.scene, np.inf, 0.0
    energy = kinetic(scene, scene.body_set.velocity)
    thickness = next(part for part in scene.parts.values() if isinstance(part, Plane)).thickness
    for state in trial.watch((*range(1, FLYING + 1), FLYING + LAST)):
        lowest = min(lowest, float(state.position[:, 1].min()))
        if state.step <= FLYING:
            peak = max(peak, kinetic(scene, state.velocity))
    bent = out_of_shape(scene, _moving(state)[0]) / scene.body_set.spacing
    return [
        Check("deepest under the plane's reach", thickness - lowest, "m", "<", 4 * ULP[trial.precision]),
        Check("kinetic energy over the shot's", peak / energy, "", "<", 1 + of_a_place(trial)),
        Check("out of shape over the spacing, 10 s later", bent, "", "<", 0.1),
    ]


def is_stopped_by_a_box(trial: Trial) -> list[Check]:
    """B16: a box is not swept; a particle inside leaves by the nearest face.

    It therefore stops everything that moves by less than half its thickness per substep, and reduces the energy."""
    scene = trial.scene
    box = next(part for part in scene.parts.values() if isinstance(part, Box))
    top, path = box.center[1] + box.half_size[1] + box.thickness, np.abs(scene.body_set.velocity).max() * substep(scene)
    lowest = np.inf
    for state in trial.watch(range(1, FLYING + 1)):
        lowest = min(lowest, float(state.position[:, 1].min()))
    energy = kinetic(scene, state.velocity) / kinetic(scene, scene.body_set.velocity)
    return [
        Check("deepest under the reach of its upper side", top - lowest, "m", "<", 4 * ULP[trial.precision]),
        Check("kinetic energy over the shot's", energy, "", "<", 1.0),
        Check("way a substep over its thickness", path / (2 * box.half_size[1]), ""),
    ]


def is_stopped_by_a_body(trial: Trial) -> list[Check]:
    """B16: a body that moves by an eighth of the contact distance per substep does not pass through another body.

    The other body has two layers of particles, and the first one is not caught in it either. Momentum is conserved
    except for rounding of coordinates of 1 m; energy only decreases, by at least a tenth."""
    scene, steps = trial.scene, round(0.04 / trial.dt)
    energy, most, least = kinetic(scene, scene.body_set.velocity), 0.0, np.inf
    for state in trial.watch(range(steps // FLYING, steps + 1, steps // FLYING)):
        at, velocity = _moving(state)
        most = max(most, kinetic(scene, velocity))
        least = min(least, float(centre(scene, at, 1)[1] - centre(scene, at, 0)[1]))
    names = [copy.name for copy in scene.body_set.copies]
    contact_distance = (getattr(scene.parts[names[1]], "particle_spacing") + RIGID_SPACING) / 2  # noqa: B009 - of either kind
    change = np.abs(centre(scene, velocity - scene.body_set.velocity)).max()
    return [
        Check("least height of its centre over the other's", least, "m", ">", RIGID_SPACING),
        Check("nearest particles at last over their distance", nearest(scene, at) / contact_distance, "", ">", 0.9),
        Check("kinetic energy at last over the shot's", kinetic(scene, velocity) / energy, "", "<", 0.9),
        Check("kinetic energy ever gained over the shot's", most / energy - 1, "", "<", of_a_place(trial, steps)),
        Check("speed of the centre of both, off what it was", float(change), "m/s", "<",
              steps * of_a_place(trial) / substep(scene)),
    ]  # fmt: skip


# ---------------------------------------------------------------------- B17: inside each other at the start


def is_let_go_slowly(trial: Trial) -> list[Check]:
    """B17: contacts separate particles at v, the separation speed.

    The rest of the body follows like a mass on a spring whose end moves: y = v t - v sin(w t) / w, at 2 v at most,
    whatever w. So two bodies separate at 2 v at most, with an energy of 2 mu v^2, mu = m M / (m + M): for equal bodies
    m v^2 / 2 per particle, as the row requires."""
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
    """B17: the same law, for an overlap of at most half a body, which has ended after a second.

    Then the particles are at contact distance. (Bodies that overlap more may stay caught: particles have no inside.)"""
    *judged, apart = is_let_go_slowly(trial)
    return [*judged, Check(apart.name, apart.value, apart.unit, ">", 1 - 1e-5)]


def is_pushed_out_in_place(trial: Trial) -> list[Check]:
    """B17: a collider moves particles to its surface within a step, without a speed from the depth d.

    The elastic energy of the clusters is then that of these displacements, w^2 m d^2 / 2 each, and the total never
    exceeds it."""
    scene = trial.scene
    ball = next(part for part in scene.parts.values() if isinstance(part, Sphere))
    middle, radius, clusters = np.array(ball.center), ball.radius + ball.thickness, scene.body_set.clusters
    depths = np.maximum(radius - np.linalg.norm(scene.body_set.position - middle, axis=1), 0)
    input_energy = clusters.stiffness[0] / 2 * float((clusters.mass * depths**2).sum())
    most, deepest = 0.0, -np.inf
    for state in trial.watch(range(1, 101)):
        at, velocity = _moving(state)
        deepest = max(deepest, radius - float(np.linalg.norm(at - middle, axis=1).min()))
        most = max(most, kinetic(scene, velocity) + clusters.energy(at))
    return [
        Check("energy over what its ways out bend it by", most / input_energy, "", "<", 1.0),
        Check("deepest particle inside the ball", deepest, "m", "<", of_a_place(trial)),
        Check("energy left over it", kinetic(scene, velocity) / input_energy, "", ">", 0.1),
        Check("deepest at the start", float(depths.max()), "m"),
    ]
