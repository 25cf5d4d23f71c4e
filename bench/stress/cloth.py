"""Hard cases B16 to B19: a cloth and a ball that is too fast for a step, or starts inside it; layers of cloth.

bench/stress/laws.py defines a law; bench/stress/cases.py has the scenes. Row B18 requires eight sheets; a scene has
only one, so it is one strip folded into eight layers. B19's thickness is the sheet's spacing, the largest that a scene
may have; near the fold each contact only keeps the distance that the flat sheet has there.
"""

from __future__ import annotations

import numpy as np

from softlab.bench.reference import mass_spring as reference
from softlab.bench.stress.trial import Check, Trial
from softlab.model.contact.penetration import measure
from softlab.model.core.energy import energies
from softlab.model.core.integrators import frequency_bound
from softlab.model.core.simulation import State
from softlab.model.tables.cloth import Sphere

CHECKED_STEPS = (1, 2, 3, 5, 10, 30, 60)  # steps after which a state is checked
SECONDS = 10.0  # simulated time of layers
STILL_FRACTION = 1e-3  # of the largest kinetic energy
GAP_FRACTION = 0.8  # of the thickness
SHOWN = 1  # steps after which B16 is drawn: the ball has just passed, and is out of sight later


def ball_of(trial: Trial, time: float = 0.0) -> tuple[Sphere, np.ndarray]:
    """Return the scene's ball, and its centre [m] at `time` [s]."""
    ball = next(part for part in trial.scene.parts.values() if isinstance(part, Sphere))
    return ball, np.array(ball.center) + time * np.array(ball.velocity)


def contact_radius(ball: Sphere) -> float:
    """Return the smallest distance [m] of a mass from the ball's centre."""
    return ball.radius + ball.thickness


def rounding(trial: Trial, state: State, center: np.ndarray) -> float:
    """Rounding error [m] of a distance to the ball: eight ulp of the largest coordinate (a centre and a mass, three
    axes).
    """
    largest = max(float(np.abs(state.position).max()), float(np.abs(center).max()))
    return 8 * float(np.spacing(np.float32(largest) if trial.single else np.float64(largest)))


def _overlap(trial: Trial, state: State) -> tuple[float, float]:
    """Return (depth [m] of the deepest mass inside the ball's surface, negative outside; its rounding error [m])."""
    ball, center = ball_of(trial, state.time)
    nearest = np.linalg.norm(state.position.astype(np.float64) - center, axis=1).min()
    return contact_radius(ball) - float(nearest), rounding(trial, state, center)


def _seen_energy(trial: Trial, position: np.ndarray, velocity: np.ndarray) -> float:
    """Energy [J] conserved by the scheme, in the frame of the ball."""
    return energies(trial.scene, position, velocity - np.array(ball_of(trial)[0].velocity))["conserved"]


def _wobble(trial: Trial) -> float:
    """Largest ratio of the energy conserved by symplectic Euler and Verlet to the true one, 1 / (1 - (w dt / 2)^2)."""
    return 1 / (1 - (frequency_bound(trial.scene) * trial.dt / 2) ** 2)


def fast_ball(trial: Trial) -> list[Check]:
    """B16: in its first step the ball passes the whole cloth.

    Each mass in its path must then lie on its front, and no mass may ever be inside it. Nothing may explode: in the
    frame of the ball, contacts only reduce the energy, so it never exceeds that at the start, except for the
    fluctuation of a symplectic step.
    """
    begin, at_rest = reference.start(trial.scene)
    ball, center = ball_of(trial)
    in_path = np.linalg.norm((begin - center)[:, :2], axis=1) < contact_radius(ball)
    energy, most, deepest, known = _seen_energy(trial, begin, at_rest), 0.0, -np.inf, 0.0
    behind, shown = len(begin), None
    for state in trial.watch(CHECKED_STEPS, trial.start(begin)):
        if state.step == 1:
            behind = int((state.position[in_path, 2] < ball_of(trial, state.time)[1][2]).sum())
        if state.step == SHOWN:
            shown = state
        depth, rounded = _overlap(trial, state)
        deepest, known = max(deepest, depth), max(known, rounded)
        most = max(most, _seen_energy(trial, state.position, state.velocity))
    trial.show(shown)
    return [
        Check(f"of {in_path.sum()} masses in its way passed by the ball", behind, "", "<", 1),
        Check("deepest mass inside the ball", deepest, "m", "<", known),
        Check("energy seen from the ball over the start's", most / energy, "", "<", _wobble(trial)),
    ]


def ball_inside(trial: Trial) -> list[Check]:
    """B17: masses are pushed out within a step, and only in position: the depth adds no speed.

    The elastic energy of a mass's springs is then that of its displacement, k (2 d)^2 / 2 each. It may not exceed m v^2
    / 2 at v = radius / dt, the largest speed at which a mass may be pushed out.
    """
    begin, at_rest = reference.start(trial.scene)
    ball, center = ball_of(trial)
    depths = contact_radius(ball) - np.linalg.norm(begin - center, axis=1)
    inside, mass, fastest = int((depths > 0).sum()), trial.scene.grid.mass, ball.radius / trial.dt
    stiffness = sum(4 * springs.stiffness for springs in trial.scene.cloth_springs.values())
    allowed = inside * min(stiffness * (2 * depths.max()) ** 2 / 2, mass * fastest**2 / 2)
    energy = energies(trial.scene, begin, at_rest)["conserved"]
    gained, speed, deepest, known = -np.inf, 0.0, -np.inf, 0.0
    for state in trial.watch(CHECKED_STEPS, trial.start(begin)):
        depth, rounded = _overlap(trial, state)
        deepest, known = max(deepest, depth), max(known, rounded)
        speed = max(speed, float(np.linalg.norm(state.velocity, axis=1).max()))
        gained = max(gained, energies(trial.scene, state.position, state.velocity)["conserved"] - energy)
    return [
        Check("energy gained", gained, "J", "<", allowed),
        Check("largest speed", speed, "m/s", "<", fastest),
        Check("deepest mass inside the ball", deepest, "m", "<", known),
        Check("deepest at the start", float(depths.max()), "m"),
    ]


def comes_to_rest_in_layers(trial: Trial) -> list[Check]:
    """B18 and B19: after 10 s the masses are nearly still, and the layers have not crossed.

    No two layers may be much nearer than the thickness, and no edge may pass through a triangle. Edges near each other,
    which contacts of masses with triangles do not detect, are reported.
    """
    grid, part = trial.scene.grid, trial.scene.self_collision
    assert part is not None
    peak, energy = 0.0, 0.0
    with trial.open(trial.start(reference.start(trial.scene)[0])) as simulation:
        for _ in range(trial.steps(SECONDS)):
            trial.advance(simulation, 1)
            energy = grid.mass / 2 * float((simulation.read("velocity").astype(np.float64) ** 2).sum())
            peak = max(peak, energy)
        state = trial.checked_state(simulation)
    gaps = measure(grid.rows, grid.columns, grid.spacing, state.position, part.thickness)
    return [
        Check("kinetic energy over its peak", energy / peak, "", "<", STILL_FRACTION),
        Check("smallest gap over the thickness", gaps.min_gap / part.thickness, "", ">", GAP_FRACTION),
        Check("edges through triangles", gaps.crossings, "", "<", 1),
        Check("pairs of edges that contacts miss", gaps.edge_misses, ""),
        Check("smallest gap of edges over the thickness", gaps.min_edge_gap / part.thickness, ""),
    ]
