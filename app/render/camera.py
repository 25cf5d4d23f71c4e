"""Where the drawing looks: world metres <-> window pixels. Pure arithmetic, no OpenGL.

Window coordinates count from the lower left corner, y up, in frame-buffer pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

MIN_SCALE, MAX_SCALE = 1e-6, 1e6  # pixels per metre: what float32 vertex coordinates still resolve

Margins = tuple[float, float, float, float]  # pixels kept free at the left, bottom, right, top


def finite_bounds(position: np.ndarray) -> tuple[float, ...] | None:
    """(left, bottom, right, top) [m] of the finite rows of `position` (particles, 2), or None where there is none; in space
    the lowest x, y, z, then the highest."""
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


@dataclass
class Camera:
    """`x`, `y` [m] lie at the middle of a window of `width` x `height` pixels; `scale` is pixels per metre."""

    width: int
    height: int
    x: float = 0.0
    y: float = 0.0
    scale: float = 30.0

    def matrix(self) -> np.ndarray:
        """(4, 4): homogeneous world coordinates (a column; z = 0) -> clip coordinates of OpenGL, without perspective."""
        across, up = 2 * self.scale / self.width, 2 * self.scale / self.height
        found = np.diag([across, up, 0.0, 1.0])
        found[:2, 3] = -across * self.x, -up * self.y
        return found

    def to_window(self, position: np.ndarray) -> np.ndarray:
        """(..., 2) metres -> (..., 2) pixels."""
        return (np.asarray(position, dtype=np.float64) - (self.x, self.y)) * self.scale + (
            self.width / 2,
            self.height / 2,
        )

    def to_world(self, x: float, y: float) -> tuple[float, float]:
        """Pixels -> metres."""
        return self.x + (x - self.width / 2) / self.scale, self.y + (y - self.height / 2) / self.scale

    def direction(self, columns: int, rows: int) -> tuple[float, float]:
        """The way in the plane that an arrow key points."""
        return float(columns), float(rows)

    def told(self) -> dict[str, float]:
        """What another program is told of it."""
        return {"pixels_per_metre": self.scale}

    def pan(self, dx: float, dy: float) -> None:
        """Move the picture by (dx, dy) pixels."""
        self.x -= dx / self.scale
        self.y -= dy / self.scale

    def zoom(self, factor: float, x: float, y: float) -> None:
        """Magnify by `factor` about the window point (x, y), which keeps showing the same place."""
        before = self.to_world(x, y)
        self.scale = min(max(self.scale * factor, MIN_SCALE), MAX_SCALE)
        after = self.to_world(x, y)
        self.x += before[0] - after[0]
        self.y += before[1] - after[1]

    def framing(self, bounds: Sequence[float], margins: Margins, least: float) -> Camera:
        """A camera of the same window that shows all of `bounds` (left, bottom, right, top [m]) inside the margins.

        `least` [m]: no side is taken for shorter than this, so that a single mass does not fill the window.
        """
        left, bottom, right, top = bounds
        free_width = max(self.width - margins[0] - margins[2], 16.0)
        free_height = max(self.height - margins[1] - margins[3], 16.0)
        scale = min(free_width / max(right - left, least), free_height / max(top - bottom, least))
        scale = min(max(scale, MIN_SCALE), MAX_SCALE)
        return Camera(
            self.width,
            self.height,
            (left + right) / 2 - (margins[0] - margins[2]) / 2 / scale,
            (bottom + top) / 2 - (margins[1] - margins[3]) / 2 / scale,
            scale,
        )

    def approach(self, other: Camera, share: float) -> None:
        """Go `share` (0 to 1) of the way to another camera's view."""
        self.x += (other.x - self.x) * share
        self.y += (other.y - self.y) * share
        self.scale *= (other.scale / self.scale) ** share
