"""Sampling of a body by particles: a lattice inside, further particles in its gaps, and particles on the surface where
the lattice does not reach it. The parameters are those of NVIDIA Flex (flexExtCreateSoftFromMesh): the volume sampling
is the resolution of the candidates inside, the surface sampling the density of the candidates on the surface. Particles
are chosen from both so that none is nearer to another than CLOSEST spacings and no candidate could be added.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.model.base.errors import InputError, SceneError
from softlab.model.geometry.arithmetic.functions import whole_power
from softlab.model.geometry.arithmetic.ordered import dot, mean, norm, total
from softlab.model.geometry.measures import triangle_areas
from softlab.model.geometry.neighbours import nearest, spread
from softlab.model.geometry.solid import Solid
from softlab.model.geometry.voxels import Runs, divided, runs_inside

CLOSEST = 0.9  # spacings: over sqrt(3)/2, the farthest from a full lattice's points, so that none is added within it
COVERED_WITHIN = 3**0.5 / 2  # spacings: points so near to a particle count as covered, as all do in a full lattice
MAX_PARTICLES = 5_000_000
MAX_ALONG = 2**16  # spacings along an axis: three of them number a lattice's points
MAX_SAMPLES = 2**25  # tried on a surface, 100 B each
MEASURED = 3  # lattice points a spacing, along an axis, with which volumes are measured: odd, see `divided`
MAX_MEASURED = 2**27  # or one a spacing
MIN_MASS_FRACTION = 0.25  # of the mean mass: a particle in a part too thin for the measuring lattice has some, too


@dataclass(frozen=True, eq=False)
class Samples:
    """`position` (particles, 3) float64 [m]: first the `interior` ones, by x, y, z on the lattice, then those in its
    gaps, then the `surface` ones; `volume` (particles,) float64 [m^3] that each represents, of `total` [m^3];
    `covered`: the fraction of the volume within REACH spacings of a particle (1 if the body is too thin to be
    measured); `overlapping`: the mesh encloses some points more than once, or inside out."""

    position: np.ndarray
    interior: int
    surface: int
    volume: np.ndarray
    total: float
    covered: float
    overlapping: bool
    filled: int = 0  # interior ones beyond the lattice's


def sample(body: Solid, spacing: float, volume_sampling: float, surface_sampling: float) -> Samples:
    """Particles about `spacing` [m] apart in a body.

    `volume_sampling`: 0, no interior; else what is tried inside is a lattice of the spacing, then one of the spacing
    over this. `surface_sampling`: number of candidates per square of the spacing, and per spacing along the longest
    side of a triangle, so that parts thinner than the spacing have some, too. Raises SceneError (spacing: larger than
    the mesh, or too many particles), InputError (no particle).
    """
    _check_size(body, spacing, volume_sampling, surface_sampling)
    inner, filled = np.zeros((0, 3)), 0
    if volume_sampling:
        inner, filled = _interior(body, spacing, volume_sampling)
    outer = np.zeros((0, 3))
    if surface_sampling:
        tried = _surface(body, spacing, surface_sampling)
        # where the lattice comes short first: tips and thin parts
        short = nearest(tried, inner)[1] if len(inner) else np.zeros(len(tried))
        outer = tried[spread(tried, inner, CLOSEST * spacing, np.floor(4 * short / spacing))]
    position = np.concatenate([inner, outer])
    if len(position) == 0:
        raise InputError(
            f"no point of a lattice of {spacing:g} m lies inside the mesh; use a smaller particle_spacing, or a "
            "surface_sampling over 0"
        )
    volume, covered, runs = _measure(body, position, spacing)
    overlapping = runs.most > 1 or runs.least < 0
    whole = runs.count * whole_power(runs.pitch, 3) if overlapping and runs.count else body.volume
    weights = np.maximum(volume, MIN_MASS_FRACTION * mean(volume)) if volume.any() else np.ones(len(volume))
    return Samples(
        position, len(inner), len(outer), weights * (whole / total(weights)), whole, covered, overlapping, filled
    )


def _expected(body: Solid, spacing: float, volume_sampling: float, surface_sampling: float) -> float:
    """Return a rough, rather high estimate of the number of particles of a spacing [m]: cubes in the volume, squares on
    the surface."""
    inside = body.volume / spacing**3 if volume_sampling else 0.0
    return inside + (body.area / (CLOSEST * spacing) ** 2 if surface_sampling or volume_sampling > 1 else 0.0)


def _check_size(body: Solid, spacing: float, volume_sampling: float, surface_sampling: float) -> None:
    size = float(np.ptp(body.position, axis=0).max())
    if spacing > size:
        raise SceneError(
            "particle_spacing", spacing, f"larger than the mesh, {size:.4g} m; at most {size / 4:.3g} gives it a shape"
        )
    if size > MAX_ALONG * spacing:
        raise SceneError(
            "particle_spacing", spacing, f"the mesh is {size:.4g} m; use at least {1.01 * size / MAX_ALONG:.3g}"
        )
    count = _expected(body, spacing, volume_sampling, surface_sampling)
    if count > MAX_PARTICLES:
        least, most = spacing, size
        while most / least > 1.001:
            middle = (least * most) ** 0.5
            enough = _expected(body, middle, volume_sampling, surface_sampling) > MAX_PARTICLES
            least, most = (middle, most) if enough else (least, middle)
        raise SceneError(
            "particle_spacing",
            spacing,
            f"gives about {count:.3g} particles, of which a body has {MAX_PARTICLES} at most; use at least "
            f"{1.01 * most:.3g} for this mesh, or another scale of it",
        )
    if surface_sampling:
        tried = float(_weights(body, spacing).sum()) * surface_sampling
        if tried > MAX_SAMPLES:
            raise SceneError(
                "surface_sampling",
                surface_sampling,
                f"tries {tried:.3g} places, at most {MAX_SAMPLES}; use at most "
                f"{0.99 * surface_sampling * MAX_SAMPLES / tried:.3g}",
            )


def _interior(body: Solid, spacing: float, sampling: float) -> tuple[np.ndarray, int]:
    """Return ((n, 3) float64 [m]: the lattice's points, then those of the finer lattice that lie far enough from them;
    the number of the latter)."""
    coarse = runs_inside(body.position, body.triangles, spacing)
    whole = [(index, place) for index, place in coarse.points()]
    if sampling == 1:
        return np.concatenate([np.zeros((0, 3)), *(place for _, place in whole)]), 0
    size = np.floor(np.ptp(body.position, axis=0) / spacing).astype(np.int64) + 4
    strides = np.array([size[1] * size[2], size[2], 1])
    taken = np.concatenate([np.zeros(0, np.int64), *(dot(index + 1, strides) for index, _ in whole)])
    tried = []
    for _, place in runs_inside(body.position, body.triangles, spacing / sampling).points():
        # within sqrt(3)/2 spacings of a lattice point that is taken none is added; most are: sorted out here
        corner = np.rint((place - coarse.origin) / spacing).astype(np.int64)
        tried.append(place[~np.isin(dot(corner + 1, strides), taken)])
    regular = np.concatenate([np.zeros((0, 3)), *(place for _, place in whole)])
    fine = np.concatenate([np.zeros((0, 3)), *tried])
    more = fine[spread(fine, regular, CLOSEST * spacing)]
    return np.concatenate([regular, more]), len(more)


def _weights(body: Solid, spacing: float) -> np.ndarray:
    """Return (triangles,): number of candidates on each, at a surface sampling of 1."""
    corners = body.position[body.triangles]
    sides = norm(np.roll(corners, -1, axis=1) - corners)
    return np.maximum(triangle_areas(body.position, body.triangles) / spacing**2, sides.max(axis=1) / spacing)


def _surface(body: Solid, spacing: float, sampling: float) -> np.ndarray:
    """Return (n, 3) float64 [m]: places on the surface, spread evenly over the triangles one after the other.

    The same in every triangle by the R2 sequence, a square's low-discrepancy points in two dimensions (M. Roberts, "The
    unreasonable effectiveness of quasirandom sequences", 2018), folded onto the triangle.
    """
    ends = np.cumsum(_weights(body, spacing))
    count = max(1, int(np.ceil(ends[-1] * sampling)))
    number = np.arange(count)
    triangle = np.minimum(np.searchsorted(ends, (number + 0.5) / count * ends[-1], "right"), len(ends) - 1)
    golden = 1.324717957244746  # the real root of x^3 = x + 1
    u, v = (0.5 + number / golden) % 1, (0.5 + number / golden**2) % 1
    folded = u + v > 1
    u, v = np.where(folded, 1 - u, u), np.where(folded, 1 - v, v)
    a, b, c = (body.position[body.triangles[triangle, k]] for k in range(3))
    return a + u[:, None] * (b - a) + v[:, None] * (c - a)


def _measure(body: Solid, position: np.ndarray, spacing: float) -> tuple[np.ndarray, float, Runs]:
    """Return the volume nearest to each particle and how much of the body they cover.

    Returns (volume (particles,) [m^3], the fraction of the body within COVERED_WITHIN spacings of a particle, the
    lattice).
    """
    parts = MEASURED if MEASURED**3 * body.volume / spacing**3 < MAX_MEASURED else 1
    runs = runs_inside(body.position, body.triangles, spacing / parts, divided(body.position, spacing, parts))
    count, covered = np.zeros(len(position)), 0
    for _, place in runs.points():
        owner, distance = nearest(place, position)
        count += np.bincount(owner, minlength=len(position))
        covered += int((distance <= COVERED_WITHIN * spacing * (1 + 1e-9)).sum())
    return count * whole_power(runs.pitch, 3), covered / runs.count if runs.count else 1.0, runs
