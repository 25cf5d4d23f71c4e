"""Closed mesh as a collider, by its sampled signed distance: the part of a scene, and its grid."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydantic import model_validator

from softlab.model.base.errors import InputError, SceneError
from softlab.model.base.table import Flag, Positive
from softlab.model.base.types import Real
from softlab.model.formulas.distance_field import HEADER
from softlab.model.geometry.mesh import read_mesh
from softlab.model.geometry.signed_distance import sampled
from softlab.model.geometry.solid import solid
from softlab.model.geometry.topology import mesh_path
from softlab.model.tables.colliders.surface_collider import SurfaceCollider

MAX_SAMPLES = 2**24 - 2**12  # 256 along each side, which takes minutes to sample; float32 counts to 2^24
ALONG, ACROSS = 64, 4  # cells along a mesh's longest side, and at least across its shortest, where none are told
MIN_ACROSS = 2  # without a point well inside there is no inside


@dataclass(frozen=True, eq=False)
class Field:
    """`distance` (points along x, y, z) float64 [m], negative inside, at low + (i, j, k) `spacing` [m]; the mesh lies
    at least `margin` [m] inside that box; `overlaps`: it intersects itself."""

    distance: np.ndarray
    low: np.ndarray
    spacing: float
    margin: float
    overlaps: bool

    def at(self, points: np.ndarray) -> np.ndarray:
        """Return (n,) float64 [m]: interpolated at `points` (n, 3) within the box, from the mesh's origin."""
        place = (points - self.low) / self.spacing
        cell = np.clip(place.astype(np.int64), 0, np.array(self.distance.shape) - 2)
        part, value = place - cell, np.zeros(len(points))
        for corner in np.ndindex(2, 2, 2):
            weight = np.where(np.array(corner) == 1, part, 1 - part).prod(axis=1)
            value += weight * self.distance[tuple((cell + corner).T)]
        return value


class DistanceField(SurfaceCollider):
    """A solid body: a closed mesh, stored as its signed distance at the points of a grid, see
    model/formulas/distance_field.py.

    A mass inside, or nearer than `thickness`, is moved to that distance; one whose path leads through is stopped where
    it enters. The cost does not depend on the number of triangles; edges are rounded to the grid's spacing.
    """

    spacing: Positive | None = None  # m, of the grid; a 64th of the mesh's longest side, or a quarter of its shortest
    fill_holes: Flag = False  # also those wider than the spacing

    @model_validator(mode="after")
    def _has_an_inside(self) -> DistanceField:
        if self.shape is not None and self.shape.name in ("sheet", "terrain"):
            raise ValueError(f"shape: a {self.shape.name} is open, so that it has no inside; make it a mesh_collider")
        return self

    def _read(self) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
        path = None if self.file is None else mesh_path(self.file)
        mesh = self.shape.mesh() if self.shape is not None else read_mesh(path or "", self.scale, inside=True)
        size = np.ptp(mesh.position, axis=0)
        try:
            body = solid(
                mesh, self.spacing or float(size.max()) / ALONG, "a mesh_collider, which may be open", self.fill_holes
            )
        except InputError as error:
            raise InputError(f"{path}: {error}" if path else str(error)) from None
        return body.position, body.triangles, body.notes

    @cached_property
    def grid(self) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Return (lowest point (3,) [m], points (3,) int64, spacing [m], margin [m]). Raises SceneError, InputError."""
        low, high = self.position.min(axis=0), self.position.max(axis=0)
        size = high - low
        longest, shortest = float(size.max()), float(size.min())
        spacing = self.spacing or min(longest / ALONG, shortest / ACROSS)
        if spacing * MIN_ACROSS > shortest:
            raise SceneError(
                "spacing", spacing, f"the mesh is {shortest:.4g} m across where it is thinnest; use at most "
                f"{shortest / ACROSS:.3g}, which gives it an inside",
            )  # fmt: skip
        points, padding, count = self._points(spacing)
        if count > MAX_SAMPLES:
            enough = spacing
            while self._points(enough)[2] > MAX_SAMPLES:
                enough *= 1.02
            remedy = f"use at least {enough:.3g}" if enough * MIN_ACROSS <= shortest else "make it a mesh_collider"
            allowed = f"gives a grid of {count:.3g} points, at most {MAX_SAMPLES}; {remedy}"
            raise SceneError("spacing", spacing, allowed)
        return (low + high) / 2 - (points - 1) / 2 * spacing, points.astype(np.int64), spacing, padding * spacing

    def _points(self, spacing: float) -> tuple[np.ndarray, float, float]:
        """Return ((3,) points along each side; cells around the mesh, more than the thickness by one or two of them;
        how many points in all), whole numbers in float64: no grid is too large to be counted."""
        with np.errstate(over="ignore"):
            padding = np.floor(np.float64(self.thickness) / spacing) + 2
            points = np.ceil(np.ptp(self.position, axis=0) / spacing) + (2 * padding + 1)
            return points, float(padding), float(points.prod())

    @cached_property
    def field(self) -> Field:
        """The samples, from the user's cache where they were made before. Raises SceneError, InputError."""
        low, points, spacing, margin = self.grid
        distance, overlaps = sampled(self.position, self.triangles, low, points, spacing)
        return Field(distance, low, spacing, margin, overlaps)

    def numbers(self, real: Real) -> np.ndarray:
        """Return the samples and constants of the field, flat (model/formulas/distance_field.py)."""
        field = self.field
        header = [*np.array(field.distance.shape) - 1, *field.low, 1 / field.spacing, field.margin]
        return np.concatenate([np.array(header), field.distance.reshape(-1)]).astype(real)

    @property
    def number_count(self) -> int:
        """Number of entries of the header and the samples."""
        return HEADER + int(self.grid[1].prod())

    def too_many(self) -> tuple[str, object, str]:
        """Return (field, value, remedy) for the error about too many samples, see SurfaceCollider."""
        _, points, spacing, _ = self.grid
        return (
            "spacing",
            spacing,
            f"{points.prod()} samples are too many together with the other fields; use {2 * spacing:.3g}",
        )

    def lines(self) -> list[str]:
        """Return the lines of other surfaces, and the grid with the largest distance of its surface from the mesh's
        corners."""
        field, off = self.field, float(np.abs(self.field.at(self.position)).max())
        grid = " x ".join(str(count) for count in field.distance.shape)
        lines = [*super().lines(), f"distances at {grid} points, {field.spacing:.4g} m apart: at most {off:.2g} m off at "
                 "the mesh's corners"]  # fmt: skip
        if field.overlaps:
            lines.append("the mesh intersects itself, so that distances inside may refer to an inner part")
        return lines
