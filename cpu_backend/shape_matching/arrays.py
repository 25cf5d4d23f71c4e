"""Arrays of clusters of particles for the CPU kernels, in named groups; the group of a feature that a scene lacks is
empty. Arrays are flat; `clusters` and `entries` are numbers of clusters and of their particles with ghosts."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


class Shapes(NamedTuple):
    """Clusters that deform: constants (S_ of formulas/shape_matching/deformation.py), plastic deformations at the start
    and at the end of an iteration (the same array in a step)."""

    table: np.ndarray
    plastic: np.ndarray
    plastic_after: np.ndarray


class Damping(NamedTuple):
    """Clusters of each particle: first of each particle, clusters, factors; the clusters' rigid motions, MOTION each."""

    starts: np.ndarray
    clusters: np.ndarray
    factors: np.ndarray
    motions: np.ndarray


class Rebound(NamedTuple):
    """As Damping, with factors 1 of clusters that rebound as a whole; limits (clusters,), 0 of the others; impulses and
    scales of particles, three planes each; kinds of clusters (layout.py)."""

    starts: np.ndarray
    clusters: np.ndarray
    factors: np.ndarray
    motions: np.ndarray
    limits: np.ndarray
    impulses: np.ndarray
    scales: np.ndarray
    kinds: np.ndarray


class RigidMotion(NamedTuple):
    """As Damping, with factors 1 of rigid bodies; kinds of clusters (layout.py); inertial displacements and slacks of
    particles, four planes; (1,): true if any cluster is SCATTERED."""

    starts: np.ndarray
    clusters: np.ndarray
    factors: np.ndarray
    motions: np.ndarray
    kinds: np.ndarray
    travel: np.ndarray
    scattered: np.ndarray


class Couples(NamedTuple):
    """Clusters of each particle: first of each particle, clusters, weights; the clusters' turns, SPIN each; couples of
    particles, three planes."""

    starts: np.ndarray
    clusters: np.ndarray
    weights: np.ndarray
    spins: np.ndarray
    sums: np.ndarray


class ClusterArrays(NamedTuple):
    """Entries of each cluster: starts (clusters + 1,), first particle (clusters,), 1 if its particles are in order
    (clusters,), particles (entries,), rest offsets and masses (4 planes of entries); centres of rest offsets and one over
    masses (4 a cluster)."""

    starts: np.ndarray
    firsts: np.ndarray
    straight: np.ndarray
    slots: np.ndarray
    members: np.ndarray
    centres: np.ndarray
    shapes: Shapes | tuple[()] = ()
    damping: Damping | tuple[()] = ()
    rebound: Rebound | tuple[()] = ()
    rigid: RigidMotion | tuple[()] = ()
    couples: Couples | tuple[()] = ()


class World(NamedTuple):
    """Constants, integers of random forces, colliders and their kinds."""

    parameters: Any
    integers: np.ndarray
    bodies: np.ndarray
    kinds: np.ndarray


class Steps(NamedTuple):
    """Number of steps, number of the first one, substeps of a step, iterations of a substep."""

    steps: int
    step: int
    substeps: int
    iterations: int


class ParticleClusters(NamedTuple):
    """Clusters of each particle: first of each particle, clusters, rest offsets, factors."""

    starts: np.ndarray
    clusters: np.ndarray
    rests: np.ndarray
    factors: np.ndarray


class BodyArrays(NamedTuple):
    """Arrays of steps of bodies besides positions; `factors`: of entries of clusters."""

    velocity: np.ndarray
    weights: np.ndarray
    clusters: ClusterArrays
    factors: np.ndarray
    own: ParticleClusters
    rotation: np.ndarray
    frames: np.ndarray
    scratch: np.ndarray
    world: World
