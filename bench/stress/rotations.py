"""Hard case B20: rotations that clusters compute for the worst matrices, and goals of flat, straight and single ones.

bench/stress/trial.py defines the result of a law; bench/stress/body_cases.py has the scene. A cluster of six particles
of mass 1/2 at the ends of three axes, moved to +-A e, has the matrix A, exactly and in any precision, so that any
matrix passes through the kernels of bodies. The nearest rotation is computed in NumPy float64 by singular value
decomposition, without anything of model/formulas.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import pairwise, product

import numpy as np

from softlab.bench.experiments.body_scenes import ULP, start
from softlab.bench.experiments.clusters_by_hand import by_hand, clusters_of, degenerate
from softlab.bench.stress.laws import Law
from softlab.bench.stress.trial import Check, Trial
from softlab.model.assets.clusters import Clusters
from softlab.model.core.simulation import State
from softlab.model.formulas.rotation import REACHED, SLACK

COUNT = 1000  # matrices per set
# (6, 3), ordered so that sums cancel at once
AXES = np.repeat(np.eye(3), 2, axis=0) * [[1], [-1], [1], [-1], [1], [-1]]
SCALES = (1.0, 1e-12, 1e12)
TURNS = 50  # random rotations of each degenerate cluster
PROPER = 1e-6  # bound of A10, shape matching and rotations
TRACE = REACHED + SLACK + 16  # roundings of 2: |b| at convergence, the error of H, and rounding


def finds_rotations(count: int = COUNT, only: Sequence[str] | None = None) -> Law:
    """Make a law: for any matrix and previous rotation, R is proper and optimal.

    R'R = I and det R = +1 to PROPER; trace(R'A) = s1 + s2 + sign(det A) s3 to TRACE roundings of A's largest entry. The
    same for A times 1e-12 and 1e12. `count` matrices of each set, or only of the sets `only`.
    """

    def law(trial: Trial) -> list[Check]:
        sets = sets_of_matrices(count)
        A = np.concatenate([sets[name] for name in only or sets]).astype(trial.precision).astype(np.float64)
        largest = np.abs(A).max(axis=(1, 2))
        A = A[largest > 0]  # any rotation is right for the zero matrix
        largest = largest[largest > 0]
        before = quaternions(np.random.default_rng(5), len(A))
        apart = determinant = missing = 0.0
        for scale in SCALES:
            for rotation in (None, before):
                R = matrices_of(_rotations(trial, A, scale, rotation))
                errors = off_rotation(R)
                apart, determinant = max(apart, errors[0]), max(determinant, errors[1])
                missing = max(missing, float(((best_trace(A) - (R * A).sum((1, 2))) / largest).max()))
        least = 2 * TRACE * ULP[trial.precision]
        return [
            Check("trace missing from the best, over the largest entry", missing, "", "<", least),
            Check("|det R - 1|", determinant, "", "<", PROPER),
            Check("|R'R - I|", apart, "", "<", PROPER),
            Check("matrices", float(2 * len(SCALES) * len(A)), ""),
        ]

    return law


def _rotations(trial: Trial, A: np.ndarray, scale: float, before: np.ndarray | None) -> np.ndarray:
    """Return the quaternions (n, 4) that clusters of the matrices `scale` A compute, starting from `before` (None:
    identity).
    """
    count = len(A)
    members = np.arange(6 * count).reshape(count, 6)
    mass = np.full(6 * count, scale / 2)
    clusters = clusters_of(np.tile(AXES, (count, 1)), members, mass=mass)
    now = np.einsum("nij,kj->nki", A, AXES).reshape(-1, 3)
    rotation = _one_step(trial, clusters, now, before).rotation
    assert rotation is not None
    return rotation


def _one_step(trial: Trial, clusters: Clusters, position: np.ndarray, rotation: np.ndarray | None = None) -> State:
    scene = by_hand(clusters)
    with trial.open(start(scene, position, rotation=rotation), scene=scene) as simulation:
        trial.advance(simulation, 1)
        return simulation.state()


def goals_are_exact(turns: int = TURNS) -> Law:
    """Make a law on clusters that are flat, collinear, of two, one or no particles, or coincident, in any rotation.

    Their goals are the places of their particles to 1e-6 of their size, twice that in float32, although R is not
    unique; and R is proper. (|b| <= 16 eps rotates by 16 eps / (s2 + s3) at most where it moves particles at all.)
    """

    def law(trial: Trial) -> list[Check]:
        one, q = degenerate(), quaternions(np.random.default_rng(1), turns)
        clusters, position = _rotated_copies(one, matrices_of(q))
        state = _one_step(trial, clusters, position)
        moved = float(np.abs(state.position.astype(np.float64) - position).max())
        size = float(np.abs(one.rest).max())
        assert state.rotation is not None
        apart, determinant = off_rotation(matrices_of(state.rotation))
        return [
            Check("way to a goal over the size of its cluster", moved / size, "", "<", 2e-6 if trial.single else 1e-6),
            Check("|det R - 1|", determinant, "", "<", PROPER),
            Check("|R'R - I|", apart, "", "<", PROPER),
            Check("clusters", float(clusters.count), ""),
        ]

    return law


def _rotated_copies(one: Clusters, turns: np.ndarray) -> tuple[Clusters, np.ndarray]:
    """Return (a copy for each of `turns` (n, 3, 3), positions with every cluster rotated about its own centre)."""
    ends, particles = one.offsets, len(one.mass)
    members = [one.indices[a:b] + copy * particles for copy in range(len(turns)) for a, b in pairwise(ends)]
    position = np.concatenate([one.position] * len(turns))
    for copy, turn in enumerate(turns):
        for owner in range(one.count):
            cluster = one.indices[ends[owner] : ends[owner + 1]]
            position[copy * particles + cluster] = one.rest[ends[owner] : ends[owner + 1]] @ turn.T  # about the origin
    return clusters_of(np.concatenate([one.position] * len(turns)), members), position


# ---------------------------------------------------------------------- matrices, and their nearest rotations


def quaternions(random: np.random.Generator, count: int) -> np.ndarray:
    """Return uniformly distributed random unit quaternions (w, x, y, z): (count, 4)."""
    q = random.normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def matrices_of(q: np.ndarray) -> np.ndarray:
    """Return rotation matrices (n, 3, 3) of unit quaternions, in float64: v + 2w (u x v) + 2u x (u x v) of each axis."""
    w, u = q[:, :1, None].astype(float), q[:, 1:].astype(float)
    cross = np.zeros((len(q), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        cross[:, i, j], cross[:, j, i] = -u[:, k], u[:, k]
    return np.eye(3) + 2 * (w * cross + cross @ cross)


def of_singular_values(random: np.random.Generator, values: np.ndarray) -> np.ndarray:
    """Return matrices (n, 3, 3) of these singular values, the last negative for a reflection, randomly rotated on both
    sides.
    """
    left, right = (matrices_of(quaternions(random, len(values))) for _ in range(2))
    return left @ (values[:, :, None] * right)


@cache
def sets_of_matrices(count: int) -> dict[str, np.ndarray]:
    """Return sets of about `count` matrices (n, 3, 3) with close eigenvalues of Davenport's matrix, by name."""
    random = np.random.default_rng(3)
    one, zero, few = np.ones((count, 1)), np.zeros((count, 1)), np.ones((max(1, count // 10), 3))
    small, sign = 10.0 ** random.uniform(-9, -1, (count, 3)), random.choice([-1.0, 1.0], (count, 3))
    named = [np.diag(d) for d in product((-3.0, -1.0, 0.0, 1.0, 3.0), repeat=3)]
    named += [np.diag([-3.0, -2.0, -1.0]), np.ones((3, 3)), np.eye(3)[[1, 2, 0]], np.eye(3)[[1, 0, 2]]]
    values = {
        "rigid": few,
        "mirrored": few * [1, 1, -1],
        "nearly mirrored": np.array([1, 1, -1]) + sign * small,
        "flat": np.concatenate([random.uniform(0.1, 1, (count, 2)), zero], axis=1),
        "on a line": few * [1, 0, 0],
        "nearly on a line": np.concatenate([one, (sign * small)[:, 1:]], axis=1),
        "two eigenvalues nearly one": np.concatenate([one, 0.5 * one, small[:, :1] - 0.5], axis=1),
        "of any singular values": 10.0 ** random.uniform(-9, 0, (count, 3)) * sign,
    }
    sets = {name: of_singular_values(random, each) for name, each in values.items()}
    return {"random, half of them mirrored": random.normal(size=(count, 3, 3)), "by name": np.stack(named)} | sets


def best_trace(A: np.ndarray) -> np.ndarray:
    """Return s1 + s2 + sign(det A) s3, the largest trace(R'A) of a rotation R: (n,)."""
    left, s, right = np.linalg.svd(A)
    return s[:, 0] + s[:, 1] + np.linalg.det(left) * np.linalg.det(right) * s[:, 2]


def off_rotation(R: np.ndarray) -> tuple[float, float]:
    """Return (the largest entry of |R'R - I|, the largest |det R - 1|) of (n, 3, 3)."""
    apart = np.abs(R.swapaxes(1, 2) @ R - np.eye(3)).max(initial=0)
    return float(apart), float(np.abs(np.linalg.det(R) - 1).max(initial=0))
