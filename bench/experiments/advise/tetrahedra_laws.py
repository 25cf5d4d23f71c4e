"""Error laws of tetrahedral bodies by substeps and sweeps, used by `softlab advise`.

Measured in float64 on the cantilever of bench/experiments/tetrahedra.py: 400 tetrahedra, five per voxel, Poisson's
ratios 0, .3, .45 and .499, E 1e5 to 1e7 Pa, and coarser and finer meshes. Each constant is the largest value measured,
with a margin. Symbols: h a substep, a the edge of a voxel, rho the density, E Young's modulus, tau the body's own
damping [s], w the angular frequency of its slowest vibration.

- At rest, a position-based body with one sweep per substep sags too far by FIRST q of its sag, q = (1 + tau / h)
  h^2 E / (rho a^2); a rope without a damper does so by exactly h^2 k / m. With two sweeps and multipliers that persist
  it is SECOND q^2. It is more where all vertices lie on the surface (COARSE), and less in finer meshes (0.44 q with
  four voxels across, 0.68 q with two, 1.1 q with one).
- Newton's method and vertex block descent start each step at the end of the last one, and have no error at rest.
- In motion, all methods but order 2 are implicit Euler. Its damping, a factor 1 / (1 + i w h) per step, shortens the
  displacement in half a vibration by w h pi / 4 of it; on the bar by up to DAMPING times as much.
- Newton's method of order 2 shortens it by up to SWING (w h)^2. Little of that is damping, which is of order
  (w h)^3; most is due to the faster vibrations that are excited too.
- A sweep of vertex block descent removes CREEP / (1 + h^2 E / (rho a^2)) of the remaining error of a slow motion. What
  remains after the last sweep is lost from the velocity in every substep: pi / (4 w h) of it over half a vibration.
- In float32 a coordinate y has a resolution of half a digit of y 2^-23, and gravity moves it by g h^2 per solve: up to
  the ratio of both may be lost. More often it is a tenth of that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, inf, log, pi, sqrt

FIRST = ((0.45, 0.95), (0.5, 1.35))  # of q: (largest Poisson's ratio, constant)
SECOND = ((0.45, 0.55, 2.0), (0.5, 0.60, 1.5))  # (largest Poisson's ratio, constant, power of q)
COARSE = {1: 1.8, 2: 2.3}  # number of sweeps -> factor, if no vertex is inside
DAMPING = 1.5
SWING = 0.4
CREEP = 1.2
LARGEST, LEAST = 0.1, 1e-3  # range of errors in which the laws were checked
MOST = 4096  # largest number of substeps per step


@dataclass(frozen=True)
class Stiff:
    """Body as input of the laws: E [Pa], Poisson's ratio, rho [kg/m^3], a [m], tau [s], w [1/s].

    `coarse`: no vertex is inside.
    """

    young: float
    poisson: float
    density: float
    edge: float
    damping: float
    frequency: float
    coarse: bool

    def stiffness(self, h: float) -> float:
        """Return h^2 E / (rho a^2), dimensionless."""
        return h**2 * self.young / (self.density * self.edge**2)

    def excess(self, h: float, sweeps: int) -> float:
        """Return the relative excess of the sag at rest, with one or two sweeps per substep."""
        q, more = (1 + self.damping / h) * self.stiffness(h), COARSE[sweeps] if self.coarse else 1.0
        if sweeps == 1:
            return more * next(constant for most, constant in FIRST if self.poisson <= most) * q
        constant, power = next((c, p) for most, c, p in SECOND if self.poisson <= most)
        return more * constant * float(q**power)

    def damped(self, h: float, order: int = 1) -> float:
        """Return the relative loss of the displacement in half a vibration, for an order in time."""
        return DAMPING * pi * self.frequency * h / 4 if order == 1 else SWING * (self.frequency * h) ** 2

    def sweeps_of_descent(self, h: float, error: float) -> int:
        """Return the sweeps of vertex block descent that lose at most `error` of the displacement."""
        lost = error * 4 * self.frequency * h / pi  # fraction of the velocity, per substep
        return max(1, ceil(log(1 / min(lost, 1.0)) * (1 + self.stiffness(h)) / CREEP))


def gravity_lost(place: float, gravity: float, h: float) -> float:
    """Return the largest fraction of gravity [m/s^2] that a particle at coordinate `place` [m] loses in float32."""
    return 2.0**-24 * place / (gravity * h**2) if gravity > 0 else 0.0


def least_substep(place: float, gravity: float, error: float) -> float:
    """Return the substep [s] at which at most `error` of gravity is lost in float32."""
    return sqrt(gravity_lost(place, gravity, 1.0) / error)


def fewest(enough: Callable[[int], bool]) -> int | None:
    """Return the smallest number up to `MOST` from which on all are `enough`; None if there is none."""
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
    """Return (substeps per step of dt [s], sweeps per substep) of vertex block descent within `error` in motion.

    It is the pair with the fewest sweeps in total; half of the error is allowed for damping, half for unfinished
    sweeps. None if there is no such pair.
    """
    least = fewest(lambda n: max(one.damped(dt / n) for one in stiff) <= error / 2)
    best = (inf, 0, 0)
    substeps = least or MOST
    while least and substeps <= MOST:
        sweeps = max(one.sweeps_of_descent(dt / substeps, error / 2) for one in stiff)
        best = min(best, (substeps * sweeps, substeps, sweeps))
        substeps *= 2
    return None if best[0] == inf else best[1:]
