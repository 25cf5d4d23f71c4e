"""Volume fractions: the part of each voxel's tetrahedra that lies within the surface.

The integrals of the four linear shape functions of a tetrahedron over the part of it that is inside. Their sum is the
volume that scales its stiffness (the energy of a constant strain, integrated over the part inside: the finite cell
method, J. Parvizian, A. Duester, E. Rank, Computational Mechanics 41 (2007)); times the density they are its lumped
masses, whose sum and centre of mass are those of the part inside.

Sampled along the PROBES x PROBES lines of each axis that find the pieces (pieces.py), in closed form along a line, over the
same sum for the whole tetrahedron: exact where nothing is cut. Of the three axes those count that the surface crosses most.
"""

from __future__ import annotations

import numpy as np

from softlab.model.geometry.arithmetic.ordered import determinant, dot, total
from softlab.model.geometry.tetrahedra.pieces import PROBES, Chords, Pieces

MIN_FRACTION = 1e-3  # of a tetrahedron: no vertex is without mass, no tetrahedron without stiffness
MIN_STIFFNESS = (
    0.1  # of a tetrahedron: nearly empty ones carry contacts, too, and softer ones turn inside out under them
)
MIN_CORNER = 0.25  # of a tetrahedron's fraction, at each corner: bounds the frequency of a corner far from the inside
NO_CROSSING = 1e-3  # weight of an axis along which no line meets the surface
BATCH = 1 << 18  # chords at once


def fractions_of(
    pieces: Pieces, same: np.ndarray, parity: np.ndarray, shape_functions: np.ndarray, volume: float
) -> np.ndarray:
    """Integrals of the shape functions over the part inside, over those of the whole, (pieces, tetrahedra of a voxel, 4).

    `same` (pieces,): the first piece that is the same as each, which gets the sum of all; `parity` (pieces,): 0 or 1, which
    of `shape_functions` (2, tetrahedra, 4, 4), rows of coefficients of (1, x, y, z), a piece has; `volume`: of the body, in
    voxels, which the sum is scaled to unless the body overlaps itself and `volume` counts some of it several times.
    """
    sampled = _sampled(pieces, parity, shape_functions)
    fractions = np.zeros_like(sampled)
    np.add.at(fractions, same, sampled)
    first = same == np.arange(len(same))
    cut = pieces.cut & first
    fractions[cut] = _with_floor(fractions[cut])
    if not pieces.overlapping:
        whole = 1 / (6 * np.abs(determinant(shape_functions[0, :, 1:, 1:])))
        fractions[first] = _scaled_to(fractions[first], cut[first], whole, volume)
    return fractions


def _sampled(pieces: Pieces, parity: np.ndarray, shape_functions: np.ndarray) -> np.ndarray:
    """Return the integrals of each piece, (pieces, tetrahedra, 4), by sampling."""
    count = len(pieces.voxel)
    integrals = np.zeros((count, *shape_functions.shape[1:3]))
    weight = np.zeros(count)
    for axis, chords in enumerate(pieces.chords):
        crossings = np.bincount(chords.piece, chords.ends, minlength=count) ** 2 + NO_CROSSING
        sampled = _along_chords(chords, axis, count, parity, shape_functions)
        integrals += crossings[:, None, None] * (sampled / _complete(axis, shape_functions)[parity])
        weight += crossings
    integrals /= weight[:, None, None]
    integrals[~pieces.cut] = 1.0
    return integrals


def mean_of_four(fractions: np.ndarray) -> np.ndarray:
    """Return (...,): the mean of `fractions` (..., 4), exactly 1 for four ones."""
    mean: np.ndarray = dot(fractions, np.full(4, 0.25))
    return mean


def _with_floor(fractions: np.ndarray) -> np.ndarray:
    """Return `fractions` (..., 4), raised so that no tetrahedron's mean is below MIN_FRACTION, and no entry below
    MIN_CORNER of that mean."""
    inside = np.maximum(mean_of_four(fractions)[..., None], MIN_FRACTION)
    raised = np.maximum(fractions, MIN_CORNER * inside)
    floored: np.ndarray = raised * (inside / mean_of_four(raised)[..., None])
    return floored


def _scaled_to(fractions: np.ndarray, cut: np.ndarray, whole: np.ndarray, target: float) -> np.ndarray:
    """`fractions` (pieces, tetrahedra, 4), those of `cut` pieces (pieces,) times one number, so that all tetrahedra, `whole`
    (tetrahedra,) in volume, hold the volume `target`."""
    volume = dot(mean_of_four(fractions), whole)
    rest = target - float(total(volume[~cut]))
    sampled = float(total(volume[cut]))
    if rest > 0 and sampled > 0:
        fractions[cut] *= rest / sampled
    return fractions


def _complete(axis: int, shape_functions: np.ndarray) -> np.ndarray:
    """Return (2, tetrahedra, 4): the values that the lines along `axis` give for whole tetrahedra."""
    place = (np.stack(np.divmod(np.arange(PROBES**2), PROBES), axis=1) + 0.5) / PROBES
    line = np.tile(place, (2, 1))
    piece = np.repeat([0, 1], PROBES**2)
    ends = np.zeros(len(piece)), np.ones(len(piece)), np.zeros(len(piece))
    return _along_chords(Chords(piece, line, *ends), axis, 2, np.array([0, 1]), shape_functions)


def _along_chords(chords: Chords, axis: int, count: int, parity: np.ndarray, shape_functions: np.ndarray) -> np.ndarray:
    """Return (count, tetrahedra, 4): the sums of chords' integrals of the shape functions, of each piece."""
    integrals = np.zeros((count, *shape_functions.shape[1:3]))
    for begin in range(0, len(chords.piece), BATCH):
        some = slice(begin, begin + BATCH)
        piece = chords.piece[some]
        origin = np.zeros((len(piece), 3))
        origin[:, [(axis + 1) % 3, (axis + 2) % 3]] = chords.line[some]
        for tetrahedron in range(integrals.shape[1]):
            functions = shape_functions[parity[piece], tetrahedron]
            chord_integrals = _along(functions, origin, axis, chords.low[some], chords.high[some])
            for corner in range(4):
                integrals[:, tetrahedron, corner] += np.bincount(piece, chord_integrals[:, corner], minlength=count)
    return integrals / PROBES**2


def _along(functions: np.ndarray, origin: np.ndarray, axis: int, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return (n, 4): integrals of linear `functions` (n, 4, 4) along lines from `origin` (n, 3) in direction `axis`,
    from `low` to `high` (n,), where all four are positive. A line in a plane that two tetrahedra share is half of each
    one's."""
    slope = functions[..., 1 + axis]
    value = functions[..., 0] + dot(functions[..., 1:], origin[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        zero = -value / slope
    start = np.maximum(low, np.where(slope > 0, zero, -np.inf).max(axis=1))
    end = np.minimum(high, np.where(slope < 0, zero, np.inf).min(axis=1))
    level = slope == 0
    length = np.maximum(end - start, 0.0) * np.where(level & (value == 0), 0.5, 1.0).prod(axis=1)
    length[(level & (value < 0)).any(axis=1)] = 0.0
    middle = np.where(length > 0, (start + end) / 2, 0.0)
    integral: np.ndarray = length[:, None] * (value + slope * middle[:, None])
    return integral
