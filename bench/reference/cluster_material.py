"""What clusters do beside turning, in NumPy, float64, cluster by cluster: creep and damping, none of the lab's formulas.

M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005, 4.5; M. Mueller et al., "Position Based
Dynamics", J. Vis. Commun. Image R. 18, 2007, 3.5. Linear goals are those of model/clusters.py, `deformations`.
"""

from __future__ import annotations

import numpy as np

from model.clusters import Clusters


def crept(
    clusters: Clusters, position: np.ndarray, plastic: np.ndarray | None, h: float, iterations: int
) -> np.ndarray | None:
    """(clusters, 3, 3): the plastic strains after one of `iterations` of a substep h [s], from those of before, `plastic`;
    None where there are none."""
    material = clusters.material
    if plastic is None or material is None:
        return None
    turned, stretched, flat = clusters.rotations(position, plastic), clusters.strained(position, plastic), clusters.flat
    found = plastic.copy()
    for c in np.flatnonzero((material.creep > 0) & ~flat):
        seen = turned[c].T @ stretched[c]
        strain = (seen + seen.T) / 2 - np.eye(3)
        if np.linalg.norm(strain) <= material.threshold[c]:
            continue
        share = 1 - np.exp(-material.creep[c] * h / iterations)
        kept = (np.eye(3) + share * strain) @ plastic[c] - np.eye(3)
        kept *= min(1.0, material.limit[c] / np.linalg.norm(kept))
        volume = np.linalg.det(np.eye(3) + kept)
        if volume > 0:
            found[c] = (np.eye(3) + kept) / np.cbrt(volume)
    return found


def damped(clusters: Clusters, position: np.ndarray, velocity: np.ndarray, h: float) -> np.ndarray:
    """(particles, 3) [m/s]: velocities after a substep h [s] of the clusters' damping."""
    if clusters.material is None:
        return velocity
    found = velocity.copy()
    for c in np.flatnonzero(clusters.material.damping > 0):
        own = slice(clusters.offsets[c], clusters.offsets[c + 1])
        k, m = clusters.indices[own], clusters.masses[own, None]
        centre, mean = (m * position[k]).sum(axis=0) / m.sum(), (m * velocity[k]).sum(axis=0) / m.sum()
        r = position[k] - centre
        spin = np.cross(r, m * velocity[k]).sum(axis=0)
        inertia = sum(m[n, 0] * (r[n] @ r[n] * np.eye(3) - np.outer(r[n], r[n])) for n in range(len(k)))
        rigid = mean + np.cross(np.linalg.pinv(inertia, rcond=1e-12) @ spin, r)
        share = clusters.shares[own, None] * (1 - np.exp(-clusters.material.damping[c] * h))
        np.add.at(found, k, share * (rigid - velocity[k]))
    return found
