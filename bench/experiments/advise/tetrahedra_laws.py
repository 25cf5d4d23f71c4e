"""What a budget of substeps and sweeps costs bodies of tetrahedra in accuracy: the laws behind `softlab advise` of them.

Measured in float64 on the cantilever of bench/experiments/tetrahedra.py: 400 tetrahedra, five to a voxel, Poisson's ratios 0,
.3, .45 and .499, E 1e5 to 1e7 Pa, and coarser and finer meshes. Each constant is the largest that was found, and some more.
With h a substep, a a voxel's edge, rho the density, E Young's modulus, tau the body's own damping [s] and w the angular
frequency of its slowest vibration:

- At rest a position-based body of one sweep a substep sags too far by FIRST q of its sag, q = (1 + tau / h) h^2 E / (rho
  a^2), as a rope without a damper does by h^2 k / m exactly; with two sweeps and multipliers that are kept by SECOND q^2.
  Where all vertices lie on the surface it is more (COARSE); in finer meshes less (0.44 q with four voxels across, 0.68 q with
  two, 1.1 q with one).
- Newton's method and vertex block descent begin each step where the last one ended, and rest where they should.
- In motion all but order 2 are implicit Euler, whose damping shortens the way made in half a vibration by w h pi / 4 of it
  (by its factor 1 / (1 + i w h) a step), on the bar by up to DAMPING times as much.
- At order 2 Newton's method shortens it by up to SWING (w h)^2: hardly by damping, which takes a part of order (w h)^3, but
  by what becomes of the quicker vibrations that go with it.
- A sweep of vertex block descent takes CREEP / (1 + h^2 E / (rho a^2)) of what is left of a slow motion. What is left after
  the last is lost from the velocity, in every substep: pi / (4 w h) of it over half a vibration.
- In float32 a place y is kept to half a digit of y 2^-23, and gravity moves it by g h^2 a solve: the ratio of both may be
  lost. It is more often a tenth of that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, inf, log, pi, sqrt

FIRST = ((0.45, 0.95), (0.5, 1.35))  # of q: up to a Poisson's ratio, the constant
SECOND = ((0.45, 0.55, 2.0), (0.5, 0.60, 1.5))  # up to a Poisson's ratio, the constant and the power of q
COARSE = {1: 1.8, 2: 2.3}  # times as much with so many sweeps, where no vertex is inside
DAMPING = 1.5
SWING = 0.4
CREEP = 1.2
LARGEST, LEAST = 0.1, 1e-3  # errors that the laws were held against
MOST = 4096  # substeps of a step


@dataclass(frozen=True)
class Stiff:
    """A body as the laws see it: E [Pa], Poisson's ratio, rho [kg/m^3], a [m], tau [s], w [1/s]; `coarse`: no vertex is
    inside."""

    young: float
    poisson: float
    density: float
    edge: float
    damping: float
    frequency: float
    coarse: bool

    def stiffness(self, h: float) -> float:
        """h^2 E / (rho a^2), without a unit."""
        return h**2 * self.young / (self.density * self.edge**2)

    def excess(self, h: float, sweeps: int) -> float:
        """At rest, of the sag, after one or two sweeps a substep."""
        q, more = (1 + self.damping / h) * self.stiffness(h), COARSE[sweeps] if self.coarse else 1.0
        if sweeps == 1:
            return more * next(constant for most, constant in FIRST if self.poisson <= most) * q
        constant, power = next((c, p) for most, c, p in SECOND if self.poisson <= most)
        return more * constant * float(q**power)

    def damped(self, h: float, order: int = 1) -> float:
        """In motion, of the way made in half a vibration, by steps of an order in time."""
        return DAMPING * pi * self.frequency * h / 4 if order == 1 else SWING * (self.frequency * h) ** 2

    def sweeps_of_descent(self, h: float, error: float) -> int:
        """Of vertex block descent, that lose at most `error` of the way."""
        lost = error * 4 * self.frequency * h / pi  # of the velocity, in a substep
        return max(1, ceil(log(1 / min(lost, 1.0)) * (1 + self.stiffness(h)) / CREEP))


def gravity_lost(place: float, gravity: float, h: float) -> float:
    """Of gravity [m/s^2], in float32, at most, by a particle `place` [m] from 0 along it."""
    return 2.0**-24 * place / (gravity * h**2) if gravity > 0 else 0.0


def least_substep(place: float, gravity: float, error: float) -> float:
    """[s]: the one of which gravity loses at most `error` in float32."""
    return sqrt(gravity_lost(place, gravity, 1.0) / error)


def fewest(enough: Callable[[int], bool]) -> int | None:
    """The least number up to MOST that is `enough`, where all above it are, too; None if none is."""
    high = 1
    while not enough(high):
        high *= 2
        if high > MOST:
            return None
    low = high // 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def least_descent(stiff: Sequence[Stiff], dt: float, error: float) -> tuple[int, int] | None:
    """(substeps of a step of dt [s], sweeps of each) of vertex block descent within `error` in motion, the fewest sweeps of
    all: half of the error for its damping, half for what sweeps leave. None if none is."""
    least = fewest(lambda n: max(one.damped(dt / n) for one in stiff) <= error / 2)
    best = (inf, 0, 0)
    substeps = least or MOST
    while least and substeps <= MOST:
        sweeps = max(one.sweeps_of_descent(dt / substeps, error / 2) for one in stiff)
        best = min(best, (substeps * sweeps, substeps, sweeps))
        substeps *= 2
    return None if best[0] == inf else best[1:]
