"""Rigid bodies that come off colliders, and bounce off each other, as wholes: which clusters do, and what both backends read.

A collider answers particle by particle. Of a rigid body only some touch, and matching shares what they got among all. So
their impulses p_i = m_i dv_i are taken together: as a rigid motion they are worth Q = |sum p|^2 / M + L.(I^-1 L), L = sum r
x p, and they asked for D = sum m_i dv_i^2. All times s = D / Q, the mean change, weighted by them, is the one asked for: a
body that lands flat has M / (mass that touches), one on a corner what a rigid body gets there, 1 / m (1/M + (r x n) I^-1 (r
x n)). Q <= D, as the best rigid motion near any has less energy. With u_n the speed into a collider at rest, sum p.u = -(1 +
e) sum m u_n^2 and D = (1 + e)^2 sum m u_n^2, so the kinetic energy changes by s (sum p.u + D/2) = -s (1 - e^2) / 2 sum m
u_n^2: never a gain, and no loss with e = 1. This needs velocities that are a rigid motion, as those of rigid bodies are
(model/formulas/shape_matching/rigid.py).

Bodies that meet: particles' impulses p for split masses (model/formulas/particle_contact.py) ask for A = sum over contacts of
p times what lacks, of which a body has sum m n w^2 p^2, n contacts of a particle of inverse mass w. For two bodies the factor
that changes the energy most is s = (A_1 + A_2) / (Q_1 + Q_2), the same for both, so that momenta stay. A body among several
others has other factors at other contacts, and a Q of impulses that cancel. So s is no more than the mean, weighted by Q, of
both bodies' M / (mass that touches) A / D, which is A / Q of what meets flat, nor than 2 / (1 + e) of the lesser one: the
largest Q of any impulses on particles that touch is near (mass that touches) / M of their D, and an impact gains no energy up
to twice the factor that stops it.
"""

from __future__ import annotations

import numpy as np

from model.scene.scene import Scene
from model.shape_matching.clusters import Clusters


def whole_clusters(clusters: Clusters) -> np.ndarray:
    """(clusters,) bool: those that are rigid, of two particles at least, and have them for themselves."""
    sizes, count = np.diff(clusters.offsets), clusters.count
    found = np.isinf(clusters.stiffness) & (sizes > 1) & (np.bincount(clusters.owner, clusters.shares != 1, count) == 0)
    if clusters.material is not None:  # of flat ones it does nothing
        found &= ((clusters.material.linear == 0) & (clusters.material.creep == 0)) | clusters.flat
    return np.asarray(found)


def rebound_limits(clusters: Clusters) -> np.ndarray:
    """(clusters,) float64: the most that impulses are multiplied by, as if the lightest particle alone touched, under the
    middle; 0 of those that do not come off as a whole. It is reached between colliders that come nearer each other."""
    lightest = np.full(clusters.count, np.inf)
    np.minimum.at(lightest, clusters.owner, clusters.masses)
    limits: np.ndarray = np.where(whole_clusters(clusters), clusters.cluster_mass / lightest, 0.0)
    return limits


def rigid_parts(scene: Scene) -> frozenset[str]:
    """Of rigid bodies: `rigid-motion`, the code that keeps their momenta (model/formulas/shape_matching/rigid.py);
    `rigid-rebound`, where they may come off a collider; `rigid-bounce` and `contact-restitution`, where off each other.
    Also where nothing is given back: what particles alone are stopped by is undone as they come to their goals."""
    if not whole_clusters(scene.body_set.alike.loose).any():
        return frozenset()
    found = {"rigid-motion"}
    if scene.colliders:
        found.add("rigid-rebound")
    if scene.contact is not None:
        found |= {"rigid-bounce", "contact-restitution"}
    return frozenset(found)
