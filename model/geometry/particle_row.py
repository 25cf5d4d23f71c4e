"""The particles of a scene's bodies in the form of a sheet with one row, for code that needs no more."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

PARKED = -float(2**20)  # m, along every axis: position of inactive particles; exact in any precision


class ParticleRow:
    """`position` (particles, 3) float64 [m], at the start."""

    rows: ClassVar[int] = 1
    spring_count: ClassVar[int] = 0
    position: np.ndarray

    def triangles(self) -> np.ndarray:
        """Return the triangles of the particles' surfaces, (triangles, 3) uint32; none by default."""
        return np.zeros((0, 3), np.uint32)

    def normals(self, position: np.ndarray) -> np.ndarray:
        """Return the unit normals of surfaces at `position` (particles, 3), (particles, 3) float64; 0 without."""
        return np.zeros((len(position), 3))

    @property
    def extent(self) -> float:
        """Longest side [m]."""
        return float(np.ptp(self.position, axis=0).max())

    @property
    def waiting(self) -> np.ndarray | None:
        """Particles that are inactive at the start, (particles,) bool; None where all are always active."""
        return None

    @property
    def columns(self) -> int:
        """Number of particles: the set is one row."""
        return len(self.position)

    @property
    def particle_count(self) -> int:
        """Number of particles, those of inactive bodies included."""
        return len(self.position)
