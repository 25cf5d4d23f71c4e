"""Spray, foam and bubbles: massless points that a fluid carries, to be drawn. They do not act on the fluid.

M. Ihmsen, N. Akinci, G. Akinci, M. Teschner, "Unified spray, foam and bubbles for particle-based fluids", The Visual
Computer 28 (2012): points are made where air is trapped (model/fluid/foam_sources.py) in the cylinder that a particle
sweeps (section 3.2). With few of the fluid's particles around them they are spray and fly; with many they are bubbles
that rise and are dragged along; otherwise they are foam, which moves with the fluid and alone ages (3.3, 3.4).
Velocities of the fluid are means over neighbours by poly6. Random numbers are counter-based (model/formulas/random.py),
so that the same states give the same points.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from softlab.model.fluid.foam_sources import foaming_speed, full_count, sources
from softlab.model.fluid.foam_walls import pushed_out
from softlab.model.formulas import random as formulas_of_random
from softlab.model.scene.scene import Scene
from softlab.model.tables.fluid import Foam

SPRAY, FOAM, BUBBLE = range(3)
NAMES = ("spray", "foam", "bubbles")
FEW, MANY = (
    0.12,
    0.75,
)  # of a full neighbourhood: below spray, above bubbles (6 and 20 of 33 there; a surface has up to 0.65)
LONGEST = 0.05  # s between two states; longer intervals are cut to it
YOUNGEST = 0.25  # of the lifetime, for the weakest source
RISING = 1 / 7  # of the scene's speed: default speed of bubbles in still fluid
FAR = 3.0  # times the fluids' initial extent: spray farther from them is removed
SPREAD = 0.1  # of a particle's speed: outward speed of a point at the edge of its ball
WORD = 2.0**-32
NOWHERE = 2.0**19  # m: nothing is drawn that far from the origin, where float32 resolves at best three centimetres


def is_tracked(position: np.ndarray) -> np.ndarray:
    """Return which positions (particles, dimensions) [m] are finite and nearer than NOWHERE, (particles,) bool."""
    return np.asarray((np.abs(position) < NOWHERE).all(axis=1))


class FoamPoints:
    """The points: `position`, `velocity` (n, dimensions) [m], [m/s], `left` (n,) [s] of a foam point's remaining life,
    `kind` (n,) of SPRAY, FOAM and BUBBLE; `follow` advances them from one state of the fluid to the next."""

    def __init__(self, scene: Scene, foam: Foam):
        self.scene, self.foam = scene, foam
        self._full, self._philox = full_count(scene), formulas_of_random.philox
        gravity = scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0
        self._drag = foam.drag or foam.buoyancy * gravity / (RISING * foaming_speed(scene, foam))
        self._gravity = np.array([0.0, -gravity, 0.0])[: scene.dimensions]
        self.forget()

    def forget(self) -> None:
        """Remove all points and the time."""
        self._set_points(np.zeros((0, self.scene.dimensions)), np.zeros((0, self.scene.dimensions)), np.zeros(0))
        self.kind = np.zeros(0, np.int8)
        self._time, self._frame = -1.0, 0

    def _set_points(self, position: np.ndarray, velocity: np.ndarray, left: np.ndarray) -> None:
        self.position, self.velocity, self.left = position, velocity, left

    def __len__(self) -> int:
        return len(self.position)

    def follow(self, position: np.ndarray, velocity: np.ndarray, time: float) -> None:
        """Advance to a state of the fluid, (particles, dimensions) [m], [m/s], at `time` [s].

        At an earlier time, or at the first state, points start again. Particles that are not finite, or beyond NOWHERE,
        are ignored.
        """
        if time < self._time or self._time < 0:
            self.forget()
            self._time = time
            return
        passed, self._time = min(time - self._time, LONGEST), time
        there = np.flatnonzero(is_tracked(position) & np.isfinite(velocity).all(axis=1))
        if passed <= 0 or not len(there):
            return
        position, velocity = (np.asarray(array, np.float64)[there] for array in (position, velocity))
        self._frame += 1
        self._carry(position, velocity, passed)
        self._make(position, velocity, passed)

    # ------------------------------------------------------------------ existing points

    def _carry(self, position: np.ndarray, velocity: np.ndarray, passed: float) -> None:
        """Move each point by its kind, out of colliders, and remove old and far ones."""
        if not len(self):
            return
        count, mean = self._around(position, velocity)
        fullness = count / self._full
        self.kind = np.where(fullness < FEW, SPRAY, np.where(fullness > MANY, BUBBLE, FOAM)).astype(np.int8)
        moving = self.velocity + passed * self._gravity  # spray
        risen = self.velocity - self.foam.buoyancy * passed * self._gravity
        dragged = risen + (1 - np.exp(-self._drag * passed)) * (mean - risen)
        kind = self.kind[:, None]
        moving = np.where(kind == FOAM, mean, np.where(kind == BUBBLE, dragged, moving))
        place = self._wrapped(self.position + passed * moving)
        place, moving, touched = pushed_out(self.scene, place, passed * moving, moving, self._time, passed)
        left = self.left - passed * ((self.kind == FOAM) | touched)
        middle, max_distance = position.mean(axis=0), FAR * self.scene.fluid_set.extent + np.ptp(position, axis=0).max()
        stays = (left > 0) & (np.abs(place - middle) < max_distance).all(axis=1)
        self._set_points(place[stays], moving[stays], left[stays])
        self.kind = self.kind[stays]

    def _around(self, position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (number of the fluid's particles within a support (n,), mean of their velocities (n, dimensions))."""
        support, total = self.scene.fluid_set.support, len(self)
        place, fluid, box = self._boxed(position)
        pairs = cKDTree(place, boxsize=box).sparse_distance_matrix(
            cKDTree(fluid, boxsize=box), support, output_type="ndarray"
        )
        point, particle = pairs["i"], pairs["j"]
        weight = (1 - (pairs["v"] / support) ** 2) ** 3
        sums = np.bincount(point, weight, total)
        mean = [np.bincount(point, weight * velocity[particle, k], total) for k in range(velocity.shape[1])]
        return np.bincount(point, minlength=total), np.stack(mean, axis=1) / np.maximum(sums, 1e-30)[:, None]

    def _sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (origin, side) [m] of the box along each axis; side 0 where it does not repeat."""
        axes, domain = self.scene.dimensions, self.scene.domain
        origin, side = np.zeros((2, axes))
        for axis in range(axes):
            if domain is not None and "xyz"[axis] in domain.repeats:
                origin[axis], side[axis] = domain.origin[axis], domain.size[axis]
        return origin, side

    def _wrapped(self, place: np.ndarray) -> np.ndarray:
        origin, side = self._sides()
        return np.where(side > 0, origin + (place - origin) % np.where(side > 0, side, 1), place)

    def _boxed(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Return points and particles in a box that starts at 0, and its sides for a search; None where none
        repeats."""
        origin, side = self._sides()
        if not side.any():
            return self.position, position, None
        place, fluid = self.position, self._wrapped(position)
        low = np.where(side > 0, origin, np.minimum(place.min(axis=0), fluid.min(axis=0)))
        high = np.maximum(place.max(axis=0), fluid.max(axis=0)) - low
        box = np.where(side > 0, side, high + 4 * self.scene.fluid_set.support)
        most = np.nextafter(box, 0)
        return np.clip(place - low, 0, most), np.clip(fluid - low, 0, most), box

    # ------------------------------------------------------------------ new points

    def _make(self, position: np.ndarray, velocity: np.ndarray, passed: float) -> None:
        """Make new points from each particle's source, a fraction by chance; above the largest number the oldest are
        removed."""
        source = sources(self.scene, self.foam, position, velocity)
        particle = np.flatnonzero(source)
        wanted = self.foam.rate * passed * source[particle]
        number = np.floor(wanted + self._random(particle, 0)[0]).astype(np.int64)
        each = np.repeat(particle, number)
        if not len(each):
            return
        turn = np.arange(len(each)) - np.repeat(np.cumsum(number) - number, number) + 1  # 1, 2 ... for each particle
        place, moving = self._cylinder(position[each], velocity[each], passed, self._random(each, turn))
        displacement = place - position[each]
        place, moving, _ = pushed_out(self.scene, self._wrapped(place), displacement, moving, self._time, 0.0)
        left = self.foam.lifetime * (YOUNGEST + (1 - YOUNGEST) * source[each])
        most = self.foam.most
        old = self.position, self.velocity, self.left
        self._set_points(*(np.concatenate(pair)[-most:] for pair in zip(old, (place, moving, left), strict=True)))
        self.kind = np.concatenate([self.kind, np.full(len(each), FOAM, np.int8)])[-most:]

    def _random(self, particle: np.ndarray, turn: int | np.ndarray) -> list[np.ndarray]:
        """Return four numbers in [0, 1) for each particle (n,), in this frame and `turn`."""
        step = np.uint64(self._frame) | (np.asarray(turn, np.uint64) << np.uint64(32))
        step = np.broadcast_to(step, particle.shape)
        words = self._philox(np.uint64(self.foam.seed), step, particle.astype(np.uint64))
        return [word * WORD for word in words]

    def _cylinder(
        self, position: np.ndarray, velocity: np.ndarray, passed: float, random: list[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and velocities of new points, by section 3.2.

        Positions are uniform within the cylinder (in a plane: the strip) that a particle's ball sweeps; points off its
        axis move outward.
        """
        radius, axes = self.scene.fluid_set.spacing / 2, position.shape[1]
        speed = np.sqrt((velocity**2).sum(axis=1))
        along = velocity / np.maximum(speed, 1e-30)[:, None]
        if axes == 2:
            aside = (2 * random[0] - 1)[:, None] * radius * np.stack([-along[:, 1], along[:, 0]], axis=1)
        else:
            least = np.abs(along).argmin(axis=1)
            one = np.cross(along, np.eye(3)[least])
            one /= np.sqrt((one**2).sum(axis=1))[:, None]
            other, angle = np.cross(along, one), 2 * np.pi * random[1]
            aside = np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * other
            aside *= (radius * np.sqrt(random[0]))[:, None]
        place = position + aside + (random[2] * passed * speed)[:, None] * along
        return place, velocity + SPREAD * speed[:, None] * aside / radius
