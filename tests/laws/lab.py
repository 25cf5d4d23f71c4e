"""How the laws run a row: on which backend, in which precision and math; and what they measure of a state."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from rows import Row

from softlab.app.driver import open_simulation
from softlab.model.core.build import build
from softlab.model.core.simulation import Simulation, State
from softlab.model.scene.scene import Scene

UNIT = {"float64": 2.0**-52, "float32": 2.0**-23}  # the spacing of numbers at 1
GRAVITY = 8.0  # m/s^2: a power of two, so that what falls is rounded as little as can be
GRID_OF_STARTS = 2.0**-10  # m: starts lie on multiples of it, so that float32 and shifts leave them as they are


@dataclass(frozen=True)
class Lab:
    """Where and in which arithmetic a law is asked."""

    backend: str = "cpu"
    precision: str = "float64"
    math: str = "exact"

    def __repr__(self) -> str:
        return "-".join([self.backend, self.precision] + [self.math] * (self.math != "exact"))

    @property
    def unit(self) -> float:
        """The spacing of numbers at 1; of `fast` math, whose quotients and roots are off by some, eight of them."""
        return UNIT[self.precision] * (8 if self.math == "fast" else 1)

    def open(self, scene: Scene, initial: State | None = None, live: Iterable[str] = ()) -> Simulation:
        """A simulation; the scheme's stability limit is not asked, since some have none."""
        threads: dict[str, Any] = {"threads": 1} if self.backend == "cpu" else {}
        return open_simulation(
            scene, self.backend, precision=self.precision, math=self.math, live=live, initial=initial,
            allow_unstable=True, **threads,
        )  # fmt: skip

    def run(self, scene: Scene, steps: int, initial: State | None = None) -> State:
        """The state after so many steps."""
        with self.open(scene, initial) as simulation:
            simulation.advance(steps)
            return simulation.state()

    def states(self, scene: Scene, steps: int, initial: State | None = None) -> list[State]:
        """The state at the start and after each step."""
        with self.open(scene, initial) as simulation:
            result = [simulation.state()]
            for _ in range(steps):
                simulation.advance(1)
                result.append(simulation.state())
            return result

    def noise(self, scene: Scene, *states: State) -> float:
        """[m/s]: what rounding of positions and velocities makes of a velocity in a substep, which a position-based
        solver takes from a difference of positions: unit * (largest coordinate / h + largest speed)."""
        h = scene.method.dt / scene.method.substeps
        places = max(float(np.abs(one.position).max(initial=0)) for one in states)
        speeds = max(float(np.abs(one.velocity).max(initial=0)) for one in states)
        return self.unit * (places / h + speeds)


def start(scene: Scene, position: Any = None, velocity: Any = None) -> State:
    """The scene's start, with other positions or velocities (one for all, or of each particle)."""
    body = build(scene)
    place = body.position if position is None else np.asarray(position, np.float64)
    speed = body.velocity if velocity is None else np.broadcast_to(np.asarray(velocity, np.float64), place.shape)
    return State(place.copy(), np.array(speed), body.inverse_mass, 0.0, 0)


def rounded(values: np.ndarray) -> np.ndarray:
    """To multiples of GRID_OF_STARTS."""
    return np.round(values / GRID_OF_STARTS) * GRID_OF_STARTS


def stirred(row: Row, scene: Scene | None = None, speed: float = 0.5, stretch: float | None = None) -> State:
    """The start, particles moved by about `stretch` of a spacing and moving at about `speed` [m/s], each differently."""
    begin, random = start(scene or row.bare), np.random.default_rng(7)
    shape = begin.position.shape
    away = random.uniform(-1, 1, shape) * (row.stretch if stretch is None else stretch) * 0.25
    moving = random.uniform(-1, 1, shape) * speed
    if row.name == "rigid_body":  # which turns, and knows no other motion
        about = begin.position - begin.position.mean(axis=0)
        moving = np.cross([1.0, 2.0, -0.5], about) + speed
    return start(scene or row.bare, rounded(begin.position + away), rounded(moving))


@cache
def stirred_run(lab: Lab, row: Row, steps: int) -> tuple[State, State]:
    """The stirred start and the state after so many steps, which many cases compare theirs with."""
    begin = stirred(row)
    return begin, lab.run(row.bare, steps, begin)


def masses(state: State) -> np.ndarray:
    """(particles, 1) [kg]"""
    return 1 / np.asarray(state.inverse_mass, np.float64)[:, None]


def momentum(state: State) -> np.ndarray:
    """(dimensions,) [kg m/s]"""
    return (masses(state) * np.asarray(state.velocity, np.float64)).sum(axis=0)


def centre(state: State) -> np.ndarray:
    """(dimensions,) [m]: of mass."""
    weight = masses(state)
    return (weight * np.asarray(state.position, np.float64)).sum(axis=0) / weight.sum()


def mean_velocity(state: State) -> np.ndarray:
    """(dimensions,) [m/s]: of the centre of mass."""
    return momentum(state) / masses(state).sum()


def in_space(vectors: np.ndarray) -> np.ndarray:
    """(..., 3) of (..., 2) or (..., 3)."""
    result = np.zeros((*vectors.shape[:-1], 3))
    result[..., : vectors.shape[-1]] = vectors
    return result


def angular_momentum(state: State) -> np.ndarray:
    """(3,) [kg m^2/s]: about the origin."""
    place, speed = in_space(np.asarray(state.position, float)), in_space(np.asarray(state.velocity, float))
    return (masses(state) * np.cross(place, speed)).sum(axis=0)


def kinetic(state: State) -> float:
    """[J]"""
    return float(0.5 * (masses(state) * np.asarray(state.velocity, np.float64) ** 2).sum())


def farthest(vectors: Any) -> float:
    """The largest length of vectors."""
    return float(np.linalg.norm(np.atleast_2d(np.asarray(vectors, np.float64)), axis=-1).max(initial=0.0))


def size(scene: Scene) -> float:
    """[m]: the largest coordinate of the scene's start."""
    return float(np.abs(build(scene).position).max())


def same_bits(one: State, other: State) -> bool:
    """Whether positions and velocities are the same to the bit."""
    return bool(np.array_equal(one.position, other.position) and np.array_equal(one.velocity, other.velocity))
