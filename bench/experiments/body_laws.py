"""Laws that bodies are compared with: loss of spin by a formula, momenta in free flight, rest after a drop.

SPIN: a rigid body, one cluster, rotates about a principal axis. A substep takes the angle D of the last one to atan(sin
D); the first is atan(omega h). Matching rotates the body by the arctangent of omega h, and the lever arms after that
rotation reduce its angular momentum by the cosine of it. More iterations do not reduce the loss; more substeps do, at
first order. FLIGHT: a soft body is thrown with spin. Split masses conserve the linear momentum to rounding; the angular
momentum decreases as that of a rigid body. DROP: a soft body falls on a plane. It is at rest when its kinetic energy is
below STILL of that of the drop; only friction, the step itself and the rebound from the plane damp it.
"""

from __future__ import annotations

from math import atan, pi, sin

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments.bar_strip import FRAME, OPTIONS, SHARED, returns_measures
from softlab.bench.measure.costs_timing import Measures
from softlab.model.base.table import Table
from softlab.model.scene.scene import Scene

SPIN, FLIGHT, DROP = "spin", "flight", "drop"
ANGULAR_MOMENTUM, SPIN_LAW, MOMENTUM, ENERGY = "body_spin_kept", "body_spin_law", "body_momentum", "body_energy"
SECONDS = {SPIN: 2.0, FLIGHT: 2.0, DROP: 10.0}
SPEED = 2 * pi  # rad/s, about the axis of SPIN and FLIGHT
THROWN = (1.0, 4.0, 0.5)  # m/s
HEIGHT = 0.5  # m, of the drop
STILL = 1e-6
GRAVITY = 9.81  # m/s^2
SAMPLED = {"shape": {"name": "beam"}, "particle_spacing": 0.0625, "volume_sampling": 1.0, "surface_sampling": 0.0}
BODIES: dict[str, Table] = {
    SPIN: {"kind": "rigid_body", "spin": [0.0, 0.0, SPEED]},
    FLIGHT: {
        "kind": "soft_body", "cluster_stiffness": 4000.0, "spin": [0.0, 0.0, SPEED], "velocity": list(THROWN),
    },
    DROP: {
        "kind": "soft_body", "cluster_stiffness": 4000.0, "angle": 20.0, "axis": [0.3, 0.2, 1.0],
        "origin": [0.0, HEIGHT + 0.25, 0.0],
    },
}  # fmt: skip


def law_scene(law: str, substeps: int) -> Scene:
    """Return the scene of a law: a beam in space, thrown, or above a plane."""
    return Scene(
        {
            "title": law.capitalize(),
            "body": SAMPLED | BODIES[law],
            "plane": {
                "point": [0.0, 0.0 if law == DROP else -1e3, 0.0], "normal": [0.0, 1.0, 0.0], "thickness": 0.03125,
                "static_friction": 0.5, "dynamic_friction": 0.4,
            },
            "gravity": {"acceleration": 0.0 if law == SPIN else GRAVITY},
            "method": {"solver": "shape-matching", "dt": FRAME, "substeps": substeps, "iterations": 1},
        },
        law,
    )  # fmt: skip


def spin_left(substeps: int) -> float:
    """Return the fraction of the spin that is left after SECONDS by the law; a rotation by D in a substep h is sin D /
    h.
    """
    h = FRAME / substeps
    angle = atan(SPEED * h)
    for _ in range(substeps * round(SECONDS[SPIN] / FRAME) - 1):
        angle = atan(sin(angle))
    return sin(angle) / (SPEED * h)


def angular_momentum(position: np.ndarray, velocity: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Return the angular momentum about the centre of mass, (3,) [kg m^2/s]."""
    m = mass[:, None]
    away = position - (m * position).sum(axis=0) / mass.sum()
    return np.cross(away, m * velocity).sum(axis=0)


def measure_law(law: str, scene: Scene, backend: str, precision: str = "float64") -> Measures:
    """Return the measures of a law.

    KEPT is the fraction of the angular momentum that is left after SECONDS. SPIN reports SPIN_LAW too; FLIGHT reports
    MOMENTUM, the difference of the linear momentum from the one by gravity, over what gravity added. ENERGY is the
    kinetic energy after a DROP over that of the fall.
    """
    names = {SPIN: (ANGULAR_MOMENTUM, SPIN_LAW), FLIGHT: (ANGULAR_MOMENTUM, MOMENTUM), DROP: (ENERGY,)}[law]
    return returns_measures(*names)(_measure_law)(law, scene, backend, precision)


def _measure_law(law: str, scene: Scene, backend: str, precision: str) -> Measures:
    body_set, steps = scene.body_set, round(SECONDS[law] / scene.method.dt)
    mass = body_set.clusters.mass
    with open_simulation(scene, backend, live=SHARED[:1], **OPTIONS | {"precision": precision}) as simulation:
        simulation.advance(steps)
        state = simulation.state()
    position, velocity = (np.asarray(array, dtype=np.float64) for array in (state.position, state.velocity))
    if law == DROP:
        energy = 0.5 * float(np.sum(mass[:, None] * velocity**2))
        return {ENERGY: (energy / float(mass.sum() * GRAVITY * HEIGHT), "", f"must be under {STILL:g}")}
    spin = angular_momentum(position, velocity, mass)
    before = angular_momentum(body_set.position, body_set.velocity, mass)
    measures: Measures = {
        ANGULAR_MOMENTUM: (float(np.linalg.norm(spin) / np.linalg.norm(before)), "", f"{SECONDS[law]:g} s")
    }
    if law == SPIN:
        return measures | {SPIN_LAW: (spin_left(scene.method.substeps), "", "the law")}
    fallen = mass.sum() * GRAVITY * SECONDS[law]
    momentum = (mass[:, None] * velocity).sum(axis=0) - mass.sum() * np.array(THROWN) + [0.0, fallen, 0.0]
    return measures | {MOMENTUM: (float(np.abs(momentum).max() / fallen), "", "off what gravity makes of it")}
