"""The camera for space: conversion between world metres and window pixels in perspective.

Pure arithmetic, no OpenGL. Window coordinates count from the lower left corner, y up, in frame-buffer pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import acos, atan2, cos, hypot, pi, sin, tan

import numpy as np

from softlab.app.render.camera import Camera, Margins

FIELD_OF_VIEW = 0.56  # rad, from the bottom to the top of the window
START_YAW, START_PITCH = 0.45, 0.28  # rad: from the right and from above, so that depth is seen at once
MAX_PITCH = 0.49 * pi  # straight from above, "up" would have no direction
TURN = 0.008  # rad per pixel of dragging
NEAREST, FARTHEST = 0.02, 60.0  # times the distance: the planes between which is drawn
MIN_DISTANCE, MAX_DISTANCE = 1e-4, 1e7  # m
MIN_FLOOR = 0.5  # cosine between the vertical and the normal of what the eye must stay above
CENTRING = 8  # steps of Newton's method, which mostly ends after three

Side = tuple[float, float]  # tangents, from the middle to the margin at smaller and at larger coordinates
Sides = tuple[Side, Side]  # across, and up


@dataclass
class Camera3D(Camera):
    """Looks from `distance` [m] at the point (`x`, `y`, `z`) [m] in the middle of a window of `width` x `height` pixels.

    `yaw` [rad]: rotation about the vertical, 0 along -z; `pitch` [rad]: elevation above the horizontal.
    """

    z: float = 0.0
    distance: float = 10.0
    yaw: float = START_YAW
    pitch: float = START_PITCH

    @property
    def target(self) -> np.ndarray:
        """Point in the middle of the window, (3,) [m]."""
        return np.array([self.x, self.y, self.z])

    @property
    def axes(self) -> np.ndarray:
        """Axes (3, 3): rows are the unit vectors to the right, up, and toward the viewer."""
        back = np.array([sin(self.yaw) * cos(self.pitch), sin(self.pitch), cos(self.yaw) * cos(self.pitch)])
        right = np.array([cos(self.yaw), 0.0, -sin(self.yaw)])
        return np.stack([right, np.cross(back, right), back])

    @property
    def eye(self) -> np.ndarray:
        """Position of the eye, (3,) [m]."""
        return self.target + self.distance * self.axes[2]

    @property
    def ahead(self) -> np.ndarray:
        """Unit vector of the view direction, (3,)."""
        return -self.axes[2]

    @property
    def nearest(self) -> float:
        """Depth of the near plane [m]."""
        return NEAREST * self.distance

    def _depth(self, seen: np.ndarray) -> np.ndarray:
        return np.asarray(self.distance - seen[..., 2])

    @property
    def focal(self) -> float:
        """Focal length: pixels per metre at a distance of a metre."""
        return self.height / 2 / tan(FIELD_OF_VIEW / 2)

    @property
    def scale(self) -> float:
        """Pixels per metre at the depth of the target."""
        return self.focal / self.distance

    def matrix(self) -> np.ndarray:
        """Implement `Camera.matrix`."""
        near, far = self.nearest, FARTHEST * self.distance
        view = np.eye(4)
        view[:3, :3] = self.axes
        view[:3, 3] = -self.axes @ self.eye
        project = np.zeros((4, 4))
        project[0, 0] = 2 * self.focal / self.width
        project[1, 1] = 2 * self.focal / self.height
        project[2, 2], project[2, 3] = (far + near) / (near - far), 2 * far * near / (near - far)
        project[3, 2] = -1.0
        return project @ view

    def as_dict(self) -> dict[str, float]:
        """Return scale, rotation and distance for the state file."""
        return {"pixels_per_metre": self.scale, "yaw": self.yaw, "pitch": self.pitch, "distance": self.distance}

    def orbit(self, dx: float, dy: float) -> None:
        """Rotate the scene about the target as a drag by (dx, dy) pixels rotates a ball."""
        self.yaw -= TURN * dx
        self.pitch = min(max(self.pitch - TURN * dy, -MAX_PITCH), MAX_PITCH)

    def stay_above(self, point: np.ndarray, normal: np.ndarray) -> None:
        """Raise the eye above the plane through `point` [m] with unit `normal` (3,) by the distance of the near plane:
        by pitch and, if that is not enough, by moving up. Walls and ceilings have no effect.

        The eye lies at target + distance * back, and back . normal = n_y sin(pitch) + h cos(pitch) with h the normal's
        part toward the viewer along the horizon: r cos(pitch - steepest), which must be at least `wanted`.
        """
        if normal[1] < MIN_FLOOR:
            return
        wanted = NEAREST + float(normal @ (point - self.target)) / self.distance
        toward = float(normal[0] * sin(self.yaw) + normal[2] * cos(self.yaw))
        length, steepest = hypot(normal[1], toward), atan2(normal[1], toward)
        least = steepest - acos(min(max(wanted / length, -1.0), 1.0))
        self.pitch = min(max(self.pitch, least), MAX_PITCH)
        missing = wanted - float(self.axes[2] @ normal)
        if missing > 0:
            self._aim(self.target + missing * self.distance * np.asarray(normal))

    def magnify(self, factor: float) -> None:
        """Implement `Camera.magnify` by a change of the distance."""
        self.distance = min(max(self.distance / factor, MIN_DISTANCE), MAX_DISTANCE)

    def holding(self, points: np.ndarray, margins: Margins, radius: float = 0.0) -> Camera3D:
        """Implement `Camera.holding`.

        With a point (x, y, z) in the camera's axes and an eye at (a, b, c), it lies left of the right margin where x -
        a <= t (c - z), t the margin's tangent: each margin bounds a +- t c, and two together bound c. A ball adds its
        radius times the length of (1, t).
        """
        seen, sides = np.asarray(points, dtype=np.float64) @ self.axes.T, self._tangents(margins)
        limits = [
            (float(low.max()) + radius * hypot(1, below), float(high.max()) + radius * hypot(1, above))
            for (low, high), (below, above) in zip(_limits(seen, sides), sides, strict=True)
        ]
        eye = np.zeros(3)
        eye[2] = max(
            (lower + upper) / (below + above) for (lower, upper), (below, above) in zip(limits, sides, strict=True)
        )
        for axis, ((lower, upper), (below, above)) in enumerate(zip(limits, sides, strict=True)):
            least, most = upper - above * eye[2], below * eye[2] - lower
            eye[axis] = _middle(seen[:, axis], eye[2] - seen[:, 2], radius, (below, above), least, most)
        middle = float(seen[:, 2].min() + seen[:, 2].max()) / 2
        distance = min(max(float(eye[2]) - middle, MIN_DISTANCE), MAX_DISTANCE)
        x, y, z = (np.array([eye[0], eye[1], middle]) @ self.axes).tolist()
        return replace(self, x=x, y=y, z=z, distance=distance)

    def outermost(self, points: np.ndarray, margins: Margins, radius: float = 0.0) -> np.ndarray:
        """Implement `Camera.outermost`: those of `points` that limit the eye."""
        seen, sides = np.asarray(points, dtype=np.float64) @ self.axes.T, self._tangents(margins)
        indices = [int(np.argmin(seen[:, 2])), int(np.argmax(seen[:, 2]))]
        eye = self.axes @ self.eye
        for axis, (limit, side) in enumerate(zip(_limits(seen, sides), sides, strict=True)):
            indices += [int(np.argmax(one)) for one in limit]
            indices += _outer(seen[:, axis] - eye[axis], eye[2] - seen[:, 2], radius, side)
        return points[indices]

    def _tangents(self, margins: Margins) -> Sides:
        """Return the tangents from the middle of the window to its margins."""
        left, bottom, right, top = margins
        return (
            (max(self.width / 2 - left, 8.0) / self.focal, max(self.width / 2 - right, 8.0) / self.focal),
            (max(self.height / 2 - bottom, 8.0) / self.focal, max(self.height / 2 - top, 8.0) / self.focal),
        )


def _limits(seen: np.ndarray, sides: Sides) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return, across and up, the bounds on the eye by both margins, for points (n, 3) in a camera's axes."""
    return [
        (below * seen[:, 2] - seen[:, axis], above * seen[:, 2] + seen[:, axis])
        for axis, (below, above) in enumerate(sides)
    ]


def _middle(place: np.ndarray, depth: np.ndarray, radius: float, side: Side, least: float, most: float) -> float:
    """Return the coordinate of the eye, between `least` and `most` [m], at which balls of `radius` [m] at `place` (n,)
    and `depth` (n,) [m] have the same distance in pixels from both margins.

    Newton's method; for two balls the equation is linear, and they are the outermost ones as seen from the last
    estimate.
    """
    below, above = (radius * hypot(1, tangent) for tangent in side)
    eye = (least + most) / 2
    for _ in range(CENTRING):
        one, other = _outer(place - eye, depth, radius, side)
        near, far = 1 / depth[one], 1 / depth[other]
        wanted = (place[one] - below) * near + (place[other] + above) * far - (side[1] - side[0])
        eye, before = min(max(float(wanted / (near + far)), least), most), eye
        if eye == before:
            break
    return eye


def _outer(away: np.ndarray, depth: np.ndarray, radius: float, side: Side) -> list[int]:
    """Return the indices of the balls that appear outermost: of `radius` [m], `away` (n,) from the middle and `depth`
    (n,) [m] from the eye."""
    below, above = (radius * hypot(1, tangent) for tangent in side)
    return [int(np.argmin((away - below) / depth)), int(np.argmax((away + above) / depth))]
