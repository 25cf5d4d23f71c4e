"""Shape matching in NumPy, float64: clusters in compressed form, rotations by singular values.

Without the lab's formulas. M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005;
model/assets/clusters.py describes split masses, and its `matching_factor` the fraction of the distance that a particle
moves towards its goals.
"""

from __future__ import annotations

import numpy as np

from softlab.bench.reference import cloth, cluster_material, mass_spring, xpbd
from softlab.bench.reference.contact.particle_contacts import Contacts
from softlab.bench.reference.steps import Motion, alone
from softlab.model.assets.clusters import Clusters
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.matching import lattice_clusters


def iterate(
    clusters: Clusters, position: np.ndarray, h: float, iterations: int, plastic: np.ndarray | None = None
) -> np.ndarray:
    """Return the position [m] after one of `iterations` of a substep h [s], pins not fixed: x + sum share b (goal - x).

    `plastic`: the strains of plastic clusters.
    """
    with np.errstate(divide="ignore"):
        fraction = 1 - (1 / (1 + clusters.stiffness * h**2)) ** (1 / iterations)
    displacements = clusters.goals(position, plastic) - position[clusters.indices]
    displacements *= (clusters.weights * fraction[clusters.owner])[:, None]
    moved = position.copy()
    np.add.at(moved, clusters.indices, displacements)
    return moved


def linked(scene: Scene, position: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
    """Return the position [m] after the links of a scene's bodies, one after another.

    M. Macklin et al., "XPBD", MIG 2016, eq. 17 and 18. Updates `multipliers` (links,) [N s^2] of the substep so far.
    """
    links, weight = scene.body_set.links, 1 / scene.body_set.clusters.mass
    h, moved = scene.method.dt / scene.method.substeps, position.copy()
    for n, (i, j) in enumerate(links.ends):
        d = moved[j] - moved[i]
        length = float(np.linalg.norm(d))
        alpha = links.compliance[n] / h**2
        change = (links.rest_length[n] - length - alpha * multipliers[n]) / (weight[i] + weight[j] + alpha)
        multipliers[n] += change
        moved[j] += weight[j] * change * d / length
        moved[i] -= weight[i] * change * d / length
    return moved


def simulate(
    scene: Scene,
    steps: int,
    position: np.ndarray | None = None,
    velocity: np.ndarray | None = None,
    first_step: int = 0,
    poke: xpbd.Poke | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position [m], velocity [m/s]) after `steps` steps of `method.dt`, (particles, dimensions) float64 each.

    Particles are in builder order. The solver shape-matching of a grid or of bodies, as its [method] says; colliders
    act at the end of every substep. Raises SceneError for another solver.
    """
    return alone(motion(scene, steps, position, velocity, first_step, poke))


def motion(
    scene: Scene,
    steps: int,
    position: np.ndarray | None = None,
    velocity: np.ndarray | None = None,
    first_step: int = 0,
    poke: xpbd.Poke | None = None,
) -> Motion:
    """Return `simulate` as a generator in which other references can intervene (`Motion`)."""
    if scene.method.solver != "shape-matching":
        raise SceneError("method.solver", scene.method.solver, "must be shape-matching here")
    begin, at_rest = (scene.body_set.position, scene.body_set.velocity) if scene.bodies else mass_spring.start(scene)
    p = begin if position is None else np.array(position, dtype=np.float64)
    v = at_rest if velocity is None else np.array(velocity, dtype=np.float64)
    method, clusters = scene.method, scene.body_set.clusters if scene.bodies else lattice_clusters(scene)
    free = ~mass_spring.pinned_mask(scene).reshape(-1, 1)
    drag = (scene.damping.coefficient if scene.damping else 0.0) / clusters.mass[:, None]
    h = method.dt / method.substeps
    fine = scene.replace({"method.dt": h})
    contacts = Contacts(scene) if scene.contact else None
    whole = cluster_material.whole_of(clusters) if scene.bodies else np.zeros(clusters.count, bool)
    of_whole = np.zeros((len(p), 1), bool)
    of_whole[clusters.indices[whole[clusters.owner]]] = True
    plastic = np.tile(np.eye(3), (clusters.count, 1, 1)) if "plastic" in clusters.parts else None
    for step in range(first_step, first_step + steps):
        for substep in range(method.substeps):
            time = (step * method.substeps + substep) * h
            a = xpbd.accelerations(scene, p, v, time, step, poke, clusters.mass)
            before = p
            p = np.where(free, p + h * (v * (1 - h * drag) + h * a), p)
            # displacement by clusters alone: a rigid body's velocity is its motion without it
            matched = np.zeros_like(p)
            if contacts:
                contacts.find(p)
            multipliers = np.zeros(len(scene.body_set.links.ends)) if scene.bodies else np.zeros(0)
            p = yield before, p
            for _ in range(method.iterations):
                if len(multipliers):
                    p = linked(scene, p, multipliers)
                bent = cluster_material.crept(clusters, p, plastic, h, method.iterations)
                iterated = np.where(free, iterate(clusters, p, h, method.iterations, plastic), p)
                p, matched, plastic = iterated, matched + (iterated - p), bent
                if contacts:
                    p = contacts.sweep(before, p)
                p = yield before, p
            if contacts and contacts.part.static_friction > 0:
                rotated = cluster_material.couple_displacements(scene.body_set.clusters, p, contacts.couples)
                p = np.where(free, p + rotated, p)
            if contacts:
                p = contacts.ended(before, p)
            old, v = v, np.where(free, (p - before - of_whole * matched) / h, 0.0)
            v = cluster_material.steadied(clusters, whole, p, v)
            if contacts and contacts.part.restitution and not whole.any():
                v = cluster_material.bounced(clusters, contacts, whole, p, old, v)
            v = cluster_material.damped(clusters, p, v, h)
            if scene.colliders:
                rows, fell = (before[None], p[None], v[None]), v
                p, v = (array[0] for array in cloth.collide(fine, *rows, step * method.substeps + substep))
                if whole.any():
                    v = cluster_material.rebounded(clusters, whole, p, fell, v)
            if contacts and whole.any():  # after colliders, which support bodies that lie on other bodies
                v = cluster_material.bounced(clusters, contacts, whole, p, old, v)
            if contacts and contacts.part.sleeping_speed:
                v = np.where(of_whole & cluster_material.unmoved(clusters, before, p), 0.0, v)
    return p, v
