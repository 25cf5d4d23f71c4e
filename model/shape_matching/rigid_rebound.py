"""Rebound of rigid bodies as wholes from colliders and from each other: which clusters do, and tables for both
backends.

A collider responds to each particle alone. Only some particles of a rigid body touch it, and matching distributes their
velocities over all. So their impulses p_i = m_i dv_i are combined: as a rigid motion they have the energy Q = |sum p|^2
/ M + L.(I^-1 L), L = sum r x p, and they required D = sum m_i dv_i^2. With the factor s = D / Q for all, their mean
change, weighted by them, is the requested one. A body that lands flat has s = M / (mass that touches), one on a corner
that of a rigid body there, 1 / m (1/M + (r x n) I^-1 (r x n)). Q <= D, as the best rigid approximation of a motion has
less energy. With u_n the speed into a collider at rest, sum p.u = -(1 + e) sum m u_n^2 and D = (1 + e)^2 sum m u_n^2,
so the kinetic energy changes by s (sum p.u + D/2) = -s (1 - e^2) / 2 sum m u_n^2: never a gain, and no loss with e = 1.
This needs velocities that are a rigid motion, as those of rigid bodies are (model/formulas/shape_matching/rigid.py).

Bodies that collide: particles' impulses p for split masses (model/formulas/particle_contact.py) ask for A = sum over
contacts of p times the missing speed, to which a body contributes sum m n w^2 p^2, with n contacts of a particle of
inverse mass w. For two bodies the factor that changes the energy most is s = (A_1 + A_2) / (Q_1 + Q_2), the same for
both, so that momenta are conserved. A body among several others has other factors at other contacts, and a Q of
impulses that cancel. So s is at most the mean, weighted by Q, of both bodies' M / (mass that touches) A / D, which is A
/ Q for flat contacts, and at most 2 / (1 + e) times the smaller one: the largest Q of any impulses on particles that
touch is near (mass that touches) / M of their D, and an impact gains no energy up to twice the factor that stops it.
"""

from __future__ import annotations

import numpy as np

from softlab.model.assets.clusters import Clusters, whole_clusters


def rebound_limits(clusters: Clusters) -> np.ndarray:
    """Return the largest factor of impulses, (clusters,) float64; 0 for clusters that do not rebound as wholes.

    It is the one at which the lightest particle alone touches, under the centre. It is reached between colliders that
    approach each other.
    """
    lightest = np.full(clusters.count, np.inf)
    np.minimum.at(lightest, clusters.owner, clusters.masses)
    limits: np.ndarray = np.where(whole_clusters(clusters), clusters.cluster_mass / lightest, 0.0)
    return limits
