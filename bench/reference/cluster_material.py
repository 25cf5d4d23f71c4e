"""Creep and damping of clusters in NumPy, float64, cluster by cluster, without the lab's formulas.

M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005, 4.5; M. Mueller et al., "Position
Based Dynamics", J. Vis. Commun. Image R. 18, 2007, 3.5. Linear goals are those of model/assets/clusters.py,
`deformations`.
"""

from __future__ import annotations

import numpy as np

from softlab.bench.reference.contact.particle_contacts import Contacts
from softlab.model.assets.clusters import Clusters


def crept(
    clusters: Clusters, position: np.ndarray, plastic: np.ndarray | None, h: float, iterations: int
) -> np.ndarray | None:
    """Return the plastic strains (clusters, 3, 3) after one of `iterations` of a substep h [s], or None.

    `plastic`: the strains before; None where there are none.
    """
    material = clusters.material
    if plastic is None or material is None:
        return None
    rotations, stretched = clusters.rotations(position, plastic), clusters.strained(position, plastic)
    strains = plastic.copy()
    for c in np.flatnonzero((material.creep > 0) & ~clusters.flat):
        seen = rotations[c].T @ stretched[c]
        strain = (seen + seen.T) / 2 - np.eye(3)
        if np.linalg.norm(strain) <= material.threshold[c]:
            continue
        fraction = 1 - np.exp(-material.creep[c] * h / iterations)
        updated = (np.eye(3) + fraction * strain) @ plastic[c] - np.eye(3)
        updated *= min(1.0, material.limit[c] / np.linalg.norm(updated))
        volume = np.linalg.det(np.eye(3) + updated)
        if volume > 0:
            strains[c] = (np.eye(3) + updated) / np.cbrt(volume)
    return strains


def rigid_motion(clusters: Clusters, c: int, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the velocities of the rigid motion with the momenta of cluster c: (entries, 3) [m/s]."""
    entries = slice(clusters.offsets[c], clusters.offsets[c + 1])
    k, m = clusters.indices[entries], clusters.masses[entries, None]
    centre, mean = (m * position[k]).sum(axis=0) / m.sum(), (m * velocity[k]).sum(axis=0) / m.sum()
    r = position[k] - centre
    spin = np.cross(r, m * velocity[k]).sum(axis=0)
    inertia = sum(m[n, 0] * (r[n] @ r[n] * np.eye(3) - np.outer(r[n], r[n])) for n in range(len(k)))
    return np.asarray(mean + np.cross(np.linalg.pinv(inertia, rcond=1e-12) @ spin, r))


LEAST = 2.0**-8  # fraction of the trace of a cluster's inertia that is added to it for a couple
FARTHEST = 0.25  # rad: largest rotation of a cluster by a couple in a substep


def couple_displacements(clusters: Clusters, position: np.ndarray, couples: np.ndarray) -> np.ndarray:
    """Return the displacements (particles, 3) [m] by the clusters' rotations under `couples` over their masses.

    `couples`: (particles, 3). Each cluster takes its fraction of them; model/formulas/shape_matching/couple.py has the
    formula.
    """
    displacements = np.zeros_like(position)
    for c in np.flatnonzero(np.diff(clusters.offsets) > 1):
        entries = slice(clusters.offsets[c], clusters.offsets[c + 1])
        k, m = clusters.indices[entries], clusters.masses[entries, None]
        couple = (m * couples[k]).sum(axis=0)
        if not couple.any():
            continue
        r = position[k] - (m * position[k]).sum(axis=0) / m.sum()
        inertia = sum(m[n, 0] * (r[n] @ r[n] * np.eye(3) - np.outer(r[n], r[n])) for n in range(len(k)))
        turn = np.linalg.solve(inertia + LEAST * np.trace(inertia) * np.eye(3), couple)
        turn *= min(1.0, FARTHEST / np.linalg.norm(turn))
        np.add.at(displacements, k, clusters.weights[entries, None] * np.cross(turn, r))
    return displacements


def whole_of(clusters: Clusters) -> np.ndarray:
    """Return a mask (clusters,) of rigid clusters of several particles, all theirs only, without strain or creep."""
    plain = np.ones(clusters.count, bool)
    if clusters.material is not None:
        plain = ((clusters.material.linear == 0) & (clusters.material.creep == 0)) | clusters.flat
    shared = np.zeros(clusters.count, bool)
    shared[clusters.owner[clusters.weights < 1]] = True
    return np.asarray(plain & ~shared & np.isinf(clusters.stiffness) & (np.diff(clusters.offsets) > 1))


def steadied(clusters: Clusters, whole: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return velocities in which those of the `whole` clusters are a rigid motion of the same momenta: (particles, 3)
    [m/s].
    """
    result = velocity.copy()
    for c in map(int, np.flatnonzero(whole)):
        entries = slice(clusters.offsets[c], clusters.offsets[c + 1])
        result[clusters.indices[entries]] = rigid_motion(clusters, c, position, velocity)
    return result


def unmoved(clusters: Clusters, before: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return a mask (particles, 1) of those that belong to no cluster with a particle that moved."""
    moved = np.zeros(clusters.count, bool)
    np.logical_or.at(moved, clusters.owner, (position != before).any(axis=1)[clusters.indices])
    awake = np.zeros((len(position), 1), bool)
    awake[clusters.indices[moved[clusters.owner]]] = True
    return ~awake


def damped(clusters: Clusters, position: np.ndarray, velocity: np.ndarray, h: float) -> np.ndarray:
    """Return velocities after a substep h [s] of the clusters' damping: (particles, 3) [m/s]."""
    rate = np.zeros(clusters.count) if clusters.material is None else clusters.material.damping
    result = velocity.copy()
    for c in map(int, np.flatnonzero(rate > 0)):
        entries = slice(clusters.offsets[c], clusters.offsets[c + 1])
        k, weight = clusters.indices[entries], clusters.weights[entries, None] * (1 - np.exp(-rate[c] * h))
        np.add.at(result, k, weight * (rigid_motion(clusters, c, position, velocity) - velocity[k]))
    return result


def worth(clusters: Clusters, c: int, position: np.ndarray, change: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Return two energies and a motion for cluster c whose particles change their velocities by `change`.

    They are (sum m v^2 of `change`, the same of the rigid motion of its momenta, that motion's velocities (entries,
    3)); model/shape_matching/rigid_rebound.py explains their use.
    """
    entries = slice(clusters.offsets[c], clusters.offsets[c + 1])
    k, m = clusters.indices[entries], clusters.masses[entries]
    rigid = rigid_motion(clusters, c, position, change)
    return float((m * (change[k] ** 2).sum(axis=1)).sum()), float((m * (rigid**2).sum(axis=1)).sum()), rigid


def rebounded(
    clusters: Clusters, whole: np.ndarray, position: np.ndarray, old: np.ndarray, velocity: np.ndarray
) -> np.ndarray:
    """Return velocities after colliders with those of the `whole` clusters as rigid bodies: (particles, 3) [m/s].

    From the velocities before (`old`) and after colliders; model/shape_matching/rigid_rebound.py has the formula.
    """
    result = velocity.copy()
    for c in map(int, np.flatnonzero(whole)):
        entries = slice(clusters.offsets[c], clusters.offsets[c + 1])
        k, m = clusters.indices[entries], clusters.masses[entries]
        wanted, resulting, rigid = worth(clusters, c, position, velocity - old)
        result[k] = old[k] + (min(wanted / resulting, m.sum() / m.min()) if resulting > 0 else 0.0) * rigid
    return result


def bounced(
    clusters: Clusters,
    contacts: Contacts,
    whole: np.ndarray,
    position: np.ndarray,
    old: np.ndarray,
    velocity: np.ndarray,
) -> np.ndarray:
    """Return velocities after particles bounced off each other, those of `whole` clusters as rigid bodies: (particles,
    3) [m/s].
    """
    scale, rigid = np.tile([1.0, 0.0, 0.0], (len(position), 1)), np.zeros(len(position), bool)
    rigid[clusters.indices[whole[clusters.owner]]] = True
    change = contacts.velocity_changes(position, old, velocity, scale, rigid)
    for c in map(int, np.flatnonzero(whole)):
        entries = slice(clusters.offsets[c], clusters.offsets[c + 1])
        k, m = clusters.indices[entries], clusters.masses[entries]
        total, resulting, _ = worth(clusters, c, position, change)
        asked, touching = (m * contacts.asked[k]).sum(), m[(change[k] != 0).any(axis=1)].sum()
        scale[k] = [m.sum() / touching * asked / total, asked, resulting] if total > 0 else 0.0
    scaled = contacts.velocity_changes(position, old, velocity, scale, rigid)
    return velocity + steadied(clusters, whole, position, scaled)
