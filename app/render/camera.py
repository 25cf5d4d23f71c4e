"""Cameras: conversion between world metres and window pixels, and the mass under the pointer; the camera for scenes in
a plane. The camera for space is in camera3d.py. Pure arithmetic, no OpenGL.

Window coordinates count from the lower left corner, y up, in frame-buffer pixels.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from softlab.model.tables.parts import CameraPart

MIN_SCALE, MAX_SCALE = 1e-6, 1e6  # pixels per metre: what float32 vertex coordinates still resolve
BEHIND = 0.25  # pixels that a pixel's length of depth counts when masses compete for the pointer

Margins = tuple[float, float, float, float]  # pixels kept free at the left, bottom, right, top


def finite_bounds(position: np.ndarray) -> tuple[float, ...] | None:
    """Return (left, bottom, right, top) [m] of the finite rows of `position` (particles, 2), or None if there are none;
    in space the lowest x, y, z, then the highest."""
    if not len(position):
        return None
    low, high = position.min(axis=0), position.max(axis=0)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):  # the slow way only where it is needed
        finite = position[np.isfinite(position).all(axis=1)]
        if not len(finite):
            return None
        low, high = finite.min(axis=0), finite.max(axis=0)
    return (*low.tolist(), *high.tolist())


def joined_bounds(every: Sequence[Sequence[float]]) -> tuple[float, ...]:
    """Return the box around boxes (at least one), each as `finite_bounds` returns it."""
    half = len(every[0]) // 2
    low = np.min([bounds[:half] for bounds in every], axis=0)
    high = np.max([bounds[half:] for bounds in every], axis=0)
    return (*low.tolist(), *high.tolist())


def box_corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the corners (2**dimensions, dimensions) of the box from `low` to `high`, each (dimensions,)."""
    axes = np.arange(len(low))
    return np.array([np.where(k >> axes & 1, high, low) for k in range(1 << len(low))])


@dataclass
class Camera(ABC):
    """Common part of the cameras: the target, which is in the middle of a window of `width` x `height` pixels, and the
    motion."""

    width: int
    height: int
    x: float = 0.0
    y: float = 0.0

    @property
    @abstractmethod
    def target(self) -> np.ndarray:
        """Point in the middle of the window, (dimensions,) [m]."""

    def _aim(self, target: np.ndarray) -> None:
        for name, part in zip("xyz", target.tolist(), strict=False):
            setattr(self, name, part)

    @property
    @abstractmethod
    def axes(self) -> np.ndarray:
        """Axes of the camera (dimensions, dimensions): rows are the unit vectors to the right, up and, in space, toward
        the viewer."""

    @property
    @abstractmethod
    def scale(self) -> float:
        """Pixels per metre at the depth of the target."""

    @property
    @abstractmethod
    def focal(self) -> float:
        """Focal length: pixels per unit of tangent, the size of a metre at a distance of a metre."""

    @property
    @abstractmethod
    def eye(self) -> np.ndarray:
        """Position of the eye, (3,) [m]."""

    @property
    @abstractmethod
    def ahead(self) -> np.ndarray:
        """Unit vector of the view direction, (3,); 0 without perspective."""

    @abstractmethod
    def _depth(self, seen: np.ndarray) -> np.ndarray:
        """Return the depth (...,) [m] of points (..., dimensions) behind the target, along the camera's axis."""

    @property
    @abstractmethod
    def nearest(self) -> float:
        """Depth [m] of the near plane; only points beyond it are drawn."""

    @abstractmethod
    def as_dict(self) -> dict[str, float]:
        """Return what the state file says of it."""

    @abstractmethod
    def matrix(self) -> np.ndarray:
        """Matrix (4, 4) from homogeneous world coordinates (a column; z = 0 in a plane) to clip coordinates of
        OpenGL."""

    @abstractmethod
    def magnify(self, factor: float) -> None:
        """Magnify the picture at the target's depth by `factor`, within the limits of drawing."""

    @abstractmethod
    def holding(self, points: np.ndarray, margins: Margins, radius: float = 0.0) -> Self:
        """Return a camera with the same direction that shows all `points` (n, dimensions) [m] inside the margins, as
        large as possible. `radius` [m]: in a plane half of the smallest side, in space the radius of balls around the
        points."""

    @abstractmethod
    def outermost(self, points: np.ndarray, margins: Margins, radius: float = 0.0) -> np.ndarray:
        """Return those of `points` that determine the camera returned by `holding`: for them alone it is the same."""

    def project(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project points (..., dimensions) [m]; returns pixels (..., 2), NaN for points that are not in front, and depths
        (...,) [m]."""
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            seen = (np.asarray(position, dtype=np.float64) - self.target) @ self.axes.T
            depth = self._depth(seen)
            depth = np.where(depth > self.nearest, depth, np.nan)
            place = seen[..., :2] * self.focal / depth[..., None] + (self.width / 2, self.height / 2)
        return place, depth

    def on_plane(self, x: float, y: float, through: Sequence[float] | np.ndarray) -> tuple[float, ...]:
        """Return the point [m] under the pixel (x, y) in the plane parallel to the window through the point `through`
        [m]."""
        seen = self.axes @ (np.asarray(through, dtype=np.float64) - self.target)
        seen[:2] = np.array([x - self.width / 2, y - self.height / 2]) * self._depth(seen) / self.focal
        return tuple((self.target + seen @ self.axes).tolist())

    def framing(self, bounds: Sequence[float], margins: Margins, least: float) -> Self:
        """Return a camera with the same direction that shows the whole box `bounds`, as `finite_bounds` returns it [m],
        inside the margins, as large as can be.

        `least` [m]: no side is taken for shorter than this, so that a single mass does not fill the window.
        """
        low, high = np.reshape(np.asarray(bounds, dtype=np.float64), (2, -1))
        grow = np.maximum(least - (high - low), 0) / 2
        return self.holding(box_corners(low - grow, high + grow), margins)

    def aim(self, part: CameraPart | None) -> None:
        """Set the view to the scene's `camera` table, as far as it is given."""
        if part is not None and part.target is not None:
            self._aim(np.array(part.target[: len(self.target)]))
        if part is not None and part.size is not None:
            self.magnify(self.height / part.size / self.scale)

    def to_window(self, position: np.ndarray) -> np.ndarray:
        """Convert (..., dimensions) metres to (..., 2) pixels; NaN for points that are not in front."""
        return self.project(position)[0]

    def direction(self, columns: int, rows: int) -> tuple[float, ...]:
        """Return the unit vector in the world that an arrow key stands for."""
        right, up = self.axes[:2]
        return tuple((columns * right + rows * up).tolist())

    def pan(self, dx: float, dy: float) -> None:
        """Move the picture at the target's depth by (dx, dy) pixels."""
        right, up = self.axes[:2]
        self._aim(self.target - (dx * right + dy * up) / self.scale)

    def zoom(self, factor: float, x: float, y: float) -> None:
        """Magnify by `factor`; the point at the target's depth under the window point (x, y) stays there."""
        before = np.array(self.on_plane(x, y, self.target))
        self.magnify(factor)
        self._aim(self.target + before - self.on_plane(x, y, self.target))

    def approach(self, other: Self, fraction: float) -> None:
        """Move by `fraction` (0 to 1) toward the target and scale of another camera. The direction, which the user
        chooses, stays."""
        self._aim(self.target + (other.target - self.target) * fraction)
        self.magnify((other.scale / self.scale) ** fraction)


@dataclass
class Camera2D(Camera):
    """Looks at a plane without perspective. `scale`: pixels per metre."""

    scale: float = 30.0
    nearest = 0.0  # no field: every point is in front

    @property
    def target(self) -> np.ndarray:
        """Point in the middle of the window, (2,) [m]."""
        return np.array([self.x, self.y])

    @property
    def axes(self) -> np.ndarray:
        """Axes (2, 2): x to the right, y up."""
        return np.eye(2)

    @property
    def focal(self) -> float:
        """Focal length, equal to the scale."""
        return self.scale

    @property
    def eye(self) -> np.ndarray:
        """Zeros (3,): there is no eye."""
        return np.zeros(3)

    @property
    def ahead(self) -> np.ndarray:
        """Zeros (3,): there is no perspective."""
        return np.zeros(3)

    def _depth(self, seen: np.ndarray) -> np.ndarray:
        return np.ones(seen.shape[:-1])

    def matrix(self) -> np.ndarray:
        """Implement `Camera.matrix`."""
        across, up = 2 * self.scale / self.width, 2 * self.scale / self.height
        transform = np.diag([across, up, 0.0, 1.0])
        transform[:2, 3] = -across * self.x, -up * self.y
        return transform

    def as_dict(self) -> dict[str, float]:
        """Return the scale for the state file."""
        return {"pixels_per_metre": self.scale}

    def magnify(self, factor: float) -> None:
        """Implement `Camera.magnify`."""
        self.scale = min(max(self.scale * factor, MIN_SCALE), MAX_SCALE)

    def holding(self, points: np.ndarray, margins: Margins, radius: float = 0.0) -> Camera2D:
        """Implement `Camera.holding`."""
        low, high = self.outermost(points, margins)
        left, bottom, right, top = margins
        free = np.maximum([self.width - left - right, self.height - bottom - top], 16.0)
        with np.errstate(divide="ignore"):
            scale = float(np.min(free / np.maximum(high - low, 2 * radius)))
        scale = min(max(scale, MIN_SCALE), MAX_SCALE)
        x, y = ((low + high) / 2 - np.array([left - right, bottom - top]) / 2 / scale).tolist()
        return Camera2D(self.width, self.height, x, y, scale)

    def outermost(self, points: np.ndarray, margins: Margins, radius: float = 0.0) -> np.ndarray:
        """Return two corners that give the same camera."""
        return np.array([points.min(axis=0), points.max(axis=0)])


def pick(camera: Camera, position: np.ndarray, x: float, y: float, max_distance: float | np.ndarray) -> int | None:
    """Return the mass at the window point (x, y), or None.

    `position` (particles, dimensions) [m]; `max_distance` [pixels], a number or (particles,).

    It is the nearest in the window, with a penalty for depth: a candidate that lies one pixel's length behind the
    foremost one counts as BEHIND pixels further from the pointer.
    """
    place, depth = camera.project(position)
    with np.errstate(invalid="ignore", over="ignore"):
        away = np.hypot(place[:, 0] - x, place[:, 1] - y)
    candidates = np.flatnonzero(away <= max_distance)  # false for NaN
    if not len(candidates):
        return None
    behind = depth[candidates] - depth[candidates].min()
    score = away[candidates] + BEHIND * behind * camera.focal / depth[candidates]
    return int(candidates[np.argmin(score)])
