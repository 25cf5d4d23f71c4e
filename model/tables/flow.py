"""The parts for inflow and outflow of a fluid: emitters and sinks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot, inf
from typing import Literal, Protocol

import numpy as np
from pydantic import model_validator

from softlab.model.base.table import ZERO, NotNegative, Part, Positive, Vector
from softlab.model.base.types import Real
from softlab.model.geometry.arithmetic.ordered import dot, norm
from softlab.model.tables.fluid import Flat

NEVER = 1e30  # s

Shape = Literal["box", "sphere", "half-space"]
OF_SHAPE = {"box": ("center", "half_size"), "sphere": ("center", "radius"), "half-space": ("point", "normal")}
SMALL = 1e-9  # of a length: rounding of lattice points at a rim


def spatial(vector: Sequence[float]) -> np.ndarray:
    """Return a vector of two or three numbers as (3,)."""
    return np.array([*vector, 0.0][:3], np.float64)


class Emitter(Part):
    """A nozzle that particles of a fluid leave at `speed` along `direction`, layer after layer, a rest distance apart,
    from `start` to `stop`. It is a disc of `radius` about `center`, or a rectangle of `size`; in a plane a line.

    Particles that have not left are inactive, and count towards the fluid's `capacity`; those that a sink removed are
    inactive again. Without inactive particles nothing comes, and the run reports how many were missing. `speed` may
    change while it runs (`live` with `taps`); 0 closes it.
    """

    fluid: str | None = None  # its part's name; by default the scene's first fluid
    center: Vector | Flat = ZERO  # m
    direction: Vector | Flat = (0.0, -1.0, 0.0)
    speed: NotNegative = 1.0  # m/s
    radius: Positive | None = None  # m, of a disc; in a plane half the line
    size: tuple[Positive, Positive] | tuple[Positive] | None = None  # m, of a rectangle, along `across` and across it
    across: Vector | Flat = (
        1.0,
        0.0,
        0.0,
    )  # direction of a rectangle's first side, projected perpendicular to the direction
    start: NotNegative = 0.0  # s
    stop: Positive | None = None  # s

    @model_validator(mode="after")
    def _is_a_nozzle(self) -> Emitter:
        if not 0 < hypot(*self.direction) < inf:
            raise ValueError("direction: must not be zero")
        if (self.radius is None) == (self.size is None):
            raise ValueError("radius: give either a radius, of a disc, or a size, of a rectangle")
        if self.stop is not None and self.stop <= self.start:
            raise ValueError(f"stop: must come after the start, {self.start:g} s")
        if self.size is not None and len(self.size) == 2 and not norm(self.axes[0]) > SMALL:
            raise ValueError("across: must not point along the direction")
        return self

    def _idle_fields(self) -> set[str]:
        return super()._idle_fields() | {name for name in type(self).model_fields if getattr(self, name) is None}

    @property
    def unit_direction(self) -> np.ndarray:
        """Unit direction, (3,)."""
        vector = spatial(self.direction)
        return vector / norm(vector)

    @property
    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Two unit vectors perpendicular to the direction, (3,) each; 0 where `across` points along it."""
        along, across = self.unit_direction, spatial(self.across)
        first = across - dot(across, along) * along
        if self.size is None and not norm(first) > SMALL:  # a disc does not depend on it
            first = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        length = norm(first)
        first = first / length if length > SMALL else np.zeros(3)
        return first, np.cross(along, first)

    def nozzle(self, rest_distance: float, dimensions: int) -> np.ndarray:
        """Return the positions of a layer's particles in the nozzle, (points, 3) [m]; none where it is narrower than
        the rest distance."""
        if dimensions == 2:
            first, second = np.array([-self.unit_direction[1], self.unit_direction[0], 0.0]), np.zeros(3)
        else:
            first, second = self.axes
        if self.radius is not None:
            wide = high = 2 * self.radius
        else:
            assert self.size is not None
            wide, high = self.size[0], self.size[-1]
        counts = [int(side / rest_distance * (1 + SMALL)) for side in (wide, high)]
        if self.radius is not None:  # one particle in its centre
            counts = [count - (count % 2 == 0) for count in counts]
        if min(counts) < 1:
            return np.zeros((0, 3))
        steps = [rest_distance * (np.arange(count) - (count - 1) / 2) for count in counts]
        if dimensions == 2:
            steps[1] = np.zeros(1)
        v, u = (grid.ravel() for grid in np.meshgrid(steps[1], steps[0], indexing="ij"))
        if self.radius is not None:
            inside = np.sqrt(u * u + v * v) <= (self.radius - rest_distance / 2) * (1 + SMALL)
            u, v = u[inside], v[inside]
        return spatial(self.center) + u[:, None] * first + v[:, None] * second


class Sink(Part):
    """A region that removes particles of any fluid: they are inactive from then on, until an emitter of their fluid
    uses them."""

    shape: Shape = "box"
    center: Vector | Flat = ZERO  # m, of a box or a sphere
    half_size: tuple[Positive, Positive, Positive] | tuple[Positive, Positive] = (0.5, 0.5, 0.5)  # m, of a box
    radius: Positive = 0.5  # m, of a sphere
    point: Vector | Flat = ZERO  # m, of the plane that bounds a half-space
    normal: Vector | Flat = (0.0, 1.0, 0.0)  # of that plane, outward

    @model_validator(mode="after")
    def _has_an_inside(self) -> Sink:
        if self.shape == "half-space" and not 0 < hypot(*self.normal) < inf:
            raise ValueError("normal: must not be zero")
        return self

    def _idle_fields(self) -> set[str]:
        used = OF_SHAPE[self.shape]
        return super()._idle_fields() | {name for names in OF_SHAPE.values() for name in names if name not in used}

    def holds(self, place: np.ndarray) -> np.ndarray:
        """Return which of the points (n, 3) [m] lie in the sink, (n,) bool."""
        if self.shape == "half-space":
            return np.asarray(dot(place - spatial(self.point), spatial(self.normal)) <= 0)
        away = place - spatial(self.center)
        if self.shape == "sphere":
            return np.asarray((away**2).sum(axis=1) <= self.radius**2)
        half = np.array([*self.half_size, np.inf][:3])
        return np.asarray((np.abs(away) <= half).all(axis=1))


FLOW_KINDS: dict[str, type[Part]] = {"emitter": Emitter, "sink": Sink}


class Lattice(Protocol):
    """A scene's fluids, as the functions below read them."""

    @property
    def spacing(self) -> float: ...
    @property
    def dimensions(self) -> int: ...


class Emitting(Protocol):
    """A scene, as the functions below read it."""

    @property
    def emitters(self) -> Mapping[str, Emitter]: ...
    @property
    def fluid_set(self) -> Lattice: ...


def initial_emitter_state(scene: Emitting) -> np.ndarray:
    """Return the initial emitter states, (emitters, 2) float64: the time [s] since which each has its speed, and the
    layers that had passed by then."""
    return np.array([(part.start, 0.0) for part in scene.emitters.values()], np.float64).reshape(-1, 2)


def layers_passed(scene: Emitting, emitter_state: np.ndarray, time: float) -> np.ndarray:
    """Return the number of layers that have passed each nozzle by `time` [s], (emitters,) float64."""
    layers, distance = [], scene.fluid_set.spacing
    for part, (since, before) in zip(scene.emitters.values(), emitter_state, strict=True):
        stop = NEVER if part.stop is None else part.stop
        layers.append(before + part.speed / distance * (min(max(time, since), stop) - since))
    return np.array(layers)


def rebased(scene: Emitting, emitter_state: np.ndarray, time: float) -> np.ndarray:
    """Return the emitter states from `time` [s] on, when speeds change from those of `scene`."""
    starts = [part.start for part in scene.emitters.values()]
    return np.stack([np.maximum(time, starts), layers_passed(scene, emitter_state, time)], axis=1).reshape(-1, 2)


def nozzle_points(scene: Emitting, real: Real) -> np.ndarray:
    """Return the points of all emitters, (points, 3) [m], in the arithmetic `real`."""
    fluids = scene.fluid_set
    points = [part.nozzle(fluids.spacing, fluids.dimensions) for part in scene.emitters.values()]
    return np.concatenate([np.zeros((0, 3)), *points]).astype(real)
