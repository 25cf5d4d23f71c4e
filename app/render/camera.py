"""Cameras: world metres <-> window pixels, and the mass under the pointer; the camera of a plane. In space: camera3d.py.
Pure arithmetic, no OpenGL.

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
    """(left, bottom, right, top) [m] of the finite rows of `position` (particles, 2), or None where there is none; in space
    the lowest x, y, z, then the highest."""
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
    """The box around boxes, each as `finite_bounds` gives it; at least one."""
    half = len(every[0]) // 2
    low = np.min([bounds[:half] for bounds in every], axis=0)
    high = np.max([bounds[half:] for bounds in every], axis=0)
    return (*low.tolist(), *high.tolist())


def box_corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(2**dimensions, dimensions): the corners of the box from `low` to `high`, each (dimensions,)."""
    axes = np.arange(len(low))
    return np.array([np.where(k >> axes & 1, high, low) for k in range(1 << len(low))])


@dataclass
class Camera(ABC):
    """Common part of the cameras of a plane and of space: the point in the middle of a window of `width` x `height` pixels,
    and its motion."""

    width: int
    height: int
    x: float = 0.0
    y: float = 0.0

    @property
    @abstractmethod
    def target(self) -> np.ndarray:
        """(dimensions,) [m], what lies in the middle of the window."""

    def _aim(self, target: np.ndarray) -> None:
        for name, part in zip("xyz", target.tolist(), strict=False):
            setattr(self, name, part)

    @property
    @abstractmethod
    def axes(self) -> np.ndarray:
        """(dimensions, dimensions): rows are the unit vectors to the right, up, and, in space, toward the viewer."""

    @property
    @abstractmethod
    def scale(self) -> float:
        """Pixels per metre at the depth of the target."""

    @property
    @abstractmethod
    def focal(self) -> float:
        """Pixels per unit of tangent: the size of a metre at a distance of a metre."""

    @property
    @abstractmethod
    def eye(self) -> np.ndarray:
        """(3,) [m], where it looks from."""

    @property
    @abstractmethod
    def ahead(self) -> np.ndarray:
        """(3,), the unit vector in which it looks; 0 without perspective."""

    @abstractmethod
    def _depth(self, seen: np.ndarray) -> np.ndarray:
        """Return (...,) [m]: the depth of points (..., dimensions) in the camera's axes, from the target."""

    @property
    @abstractmethod
    def nearest(self) -> float:
        """Depth [m] beyond which points are in front."""

    @abstractmethod
    def as_dict(self) -> dict[str, float]:
        """Return what the state file says of it."""

    @abstractmethod
    def matrix(self) -> np.ndarray:
        """(4, 4): homogeneous world coordinates (a column; z = 0 in a plane) -> clip coordinates of OpenGL."""

    @abstractmethod
    def magnify(self, factor: float) -> None:
        """Magnify what is at the target's depth by `factor`, within the limits of drawing."""

    @abstractmethod
    def holding(self, points: np.ndarray, margins: Margins, radius: float = 0.0) -> Self:
        """Return a camera turned the same way that shows all `points` (n, dimensions) [m] inside the margins, as large as
        can be. `radius` [m]: half the least side in a plane; in space the radius of balls about the points."""

    @abstractmethod
    def outermost(self, points: np.ndarray, margins: Margins, radius: float = 0.0) -> np.ndarray:
        """Return points that determine this camera, made by `holding` for `points`: for them alone it is the same."""

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
        """Return a camera turned the same way that shows the whole box `bounds`, as `finite_bounds` returns it [m], inside
        the margins, as large as can be.

        `least` [m]: no side is taken for shorter than this, so that a single mass does not fill the window.
        """
        low, high = np.reshape(np.asarray(bounds, dtype=np.float64), (2, -1))
        grow = np.maximum(least - (high - low), 0) / 2
        return self.holding(box_corners(low - grow, high + grow), margins)

    def aim(self, part: CameraPart | None) -> None:
        """Look where a scene's `camera` table says, as far as it does."""
        if part is not None and part.target is not None:
            self._aim(np.array(part.target[: len(self.target)]))
        if part is not None and part.size is not None:
            self.magnify(self.height / part.size / self.scale)

    def to_window(self, position: np.ndarray) -> np.ndarray:
        """(..., dimensions) metres -> (..., 2) pixels; NaN for what is not in front."""
        return self.project(position)[0]

    def direction(self, columns: int, rows: int) -> tuple[float, ...]:
        """The unit vector that points as an arrow key does in the window."""
        right, up = self.axes[:2]
        return tuple((columns * right + rows * up).tolist())

    def pan(self, dx: float, dy: float) -> None:
        """Move what is seen at the target's depth by (dx, dy) pixels."""
        right, up = self.axes[:2]
        self._aim(self.target - (dx * right + dy * up) / self.scale)

    def zoom(self, factor: float, x: float, y: float) -> None:
        """Magnify by `factor`; at the target's depth the window point (x, y) keeps showing the same place."""
        before = np.array(self.on_plane(x, y, self.target))
        self.magnify(factor)
        self._aim(self.target + before - self.on_plane(x, y, self.target))

    def approach(self, other: Self, fraction: float) -> None:
        """Move by `fraction` (0 to 1) toward the target and scale of another camera. The rotation, which is the user's,
        stays."""
        self._aim(self.target + (other.target - self.target) * fraction)
        self.magnify((other.scale / self.scale) ** fraction)


@dataclass
class Camera2D(Camera):
    """Looks at a plane without perspective: everything lies as if a metre away. `scale` is pixels per metre."""

    scale: float = 30.0
    nearest = 0.0  # no field: every point is in front

    @property
    def target(self) -> np.ndarray:
        """(2,) [m]"""
        return np.array([self.x, self.y])

    @property
    def axes(self) -> np.ndarray:
        """(2, 2): x to the right, y up."""
        return np.eye(2)

    @property
    def focal(self) -> float:
        """The scale."""
        return self.scale

    @property
    def eye(self) -> np.ndarray:
        """(3,): nowhere."""
        return np.zeros(3)

    @property
    def ahead(self) -> np.ndarray:
        """(3,): 0."""
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
        """Return two corners that this camera would be the same for."""
        return np.array([points.min(axis=0), points.max(axis=0)])


def pick(camera: Camera, position: np.ndarray, x: float, y: float, max_distance: float | np.ndarray) -> int | None:
    """Return the mass at the window point (x, y), or None.

    `position` (particles, dimensions) [m]; `max_distance` [pixels], one for all or (particles,).

    The nearest in the window, unless it lies behind another: a pixel's length further from the eye than the foremost
    candidate counts as BEHIND pixels further from the pointer.
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
