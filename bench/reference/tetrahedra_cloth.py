"""Tetrahedral bodies and a cloth in one scene, position-based, in slow, plain NumPy float64: the reference.

The substep of bench/reference/tetrahedra.py, with a cloth's constraints as in bench/reference/xpbd_mesh.py, attachments
(a - sum s x = 0, three components of one weight; M. Macklin et al., "XPBD", MIG 2016, eq. 17 and 18), and contacts as
in contact/surface_contacts.py. From the model it takes the meshes, the order of constraints, and the points of
tetrahedra and triangles to which vertices are attached.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softlab.bench.reference import cloth as cloth_colliders
from softlab.bench.reference import xpbd_mesh
from softlab.bench.reference.contact import surface_contacts
from softlab.bench.reference.finite_elements import Body, shape_gradients
from softlab.bench.reference.steps import Motion, alone
from softlab.bench.reference.tetrahedra import Sweep
from softlab.model.base.errors import SceneError
from softlab.model.contact.attachments import attachment_sets
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import constraint_sets, tetrahedra_of_sets


@dataclass
class Joint:
    """Vertex `corners[0]` attached to the mean of the others with `weights`, or without others to the fixed `point`."""

    corners: np.ndarray
    weights: np.ndarray
    point: np.ndarray
    compliance: float

    def project(self, position: np.ndarray, multiplier: np.ndarray, inverse_mass: np.ndarray, h: float) -> None:
        """Project the attachment in place; `multiplier` (3,) [kg m]."""
        first, others = self.corners[0], self.corners[1:]
        off = position[first] - (self.weights @ position[others] if len(others) else self.point)
        weight = inverse_mass[first] + float(self.weights**2 @ inverse_mass[others])
        alpha = self.compliance / h**2
        change = (-off - alpha * multiplier) / (weight + alpha) if weight + alpha > 0 else np.zeros(3)
        multiplier += change
        position[first] += inverse_mass[first] * change
        position[others] -= (inverse_mass[others] * self.weights)[:, None] * change


def _bodies(scene: Scene) -> list[tuple[Body, list[np.ndarray]]]:
    """Return (tetrahedra of one material, their order of projection), set by set."""
    mesh = scene.tetrahedra_set
    mu, lame = mesh.lame()
    bodies = []
    for chosen, rows in zip(tetrahedra_of_sets(mesh), constraint_sets(scene), strict=False):
        corners = mesh.tetrahedra[chosen].astype(np.int64)
        volume, gradient = shape_gradients(mesh.position, corners)
        body = Body(mesh.position, corners, rows.model, mu[chosen], lame[chosen], volume, gradient)
        bodies.append((body, rows.sweep))
    return bodies


def _joints(scene: Scene) -> list[Joint]:
    joints = []
    for rows in attachment_sets(scene.tetrahedra_set):
        for corners, values in zip(rows.corners, rows.values, strict=True):
            others = len(corners) - 1
            joints.append(Joint(corners, values[:others], values[:3], float(values[-1])))
    return joints


def simulate(
    scene: Scene, steps: int, position: np.ndarray, velocity: np.ndarray, most: int, distance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position [m], velocity [m/s]), (particles, 3) float64, after `steps` steps from the given ones.

    `most`: largest number of contacts of a vertex; `distance` [m]: that contacts keep. Raises SceneError for parts that
    are not supported here.
    """
    return alone(motion(scene, steps, position, velocity, most, distance))


def motion(scene: Scene, steps: int, position: np.ndarray, velocity: np.ndarray, most: int, distance: float) -> Motion:
    """Return `simulate` as a generator in which other references can intervene (`Motion`)."""
    if scene.motions or scene.external or any(p.mass_damping for p in scene.tetrahedra.values()):
        message = "the reference supports gravity, dampers, contacts, colliders and attachments"
        raise SceneError("scene", scene.name, message)
    mesh, method = scene.tetrahedra_set, scene.method
    (damping,) = {part.damping for part in scene.tetrahedra.values()}
    h, inverse_mass = method.dt / method.substeps, 1 / mesh.masses
    inverse_mass[mesh.pinned_vertices] = 0
    free = (inverse_mass > 0)[:, None]
    drag = (scene.damping.coefficient if scene.damping else 0.0) * inverse_mass[:, None]
    gravity = np.array([0.0, -scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0, 0.0])
    start = int(mesh.first_particle[-1])
    cloth = [replace(item, corners=item.corners + start) for item in xpbd_mesh.items_of(scene)] if scene.mesh else []
    bodies, joints = _bodies(scene), _joints(scene)
    fine = scene.replace({"method.dt": h}) if scene.colliders else scene
    p, v = np.array(position, np.float64), np.array(velocity, np.float64)
    sail = mesh.surface[(mesh.surface >= start).all(axis=1)]
    for number in range(steps * method.substeps):
        before = p
        force = xpbd_mesh.wind_on(scene, p, v, number * h, sail) if scene.wind else np.zeros_like(p)
        v = np.where(free, v * (1 - h * drag) + h * (gravity + force * inverse_mass[:, None]), 0.0)
        p = before + h * v
        sweeps = [
            Sweep(body, inverse_mass, before, h, damping / h, np.zeros((n, 3, 3)), np.zeros(n))
            for body, _ in bodies for n in [len(body.tetrahedra)]
        ]  # fmt: skip
        multipliers = [np.zeros(3 if "isometric" in item.of.__qualname__ else 1) for item in cloth]
        joint_multipliers = [np.zeros(3) for _ in joints]
        touching = surface_contacts.find(scene, distance, before, p).nearest(most) if scene.contact else None
        sums = np.zeros((len(touching.mass) if touching else 0, 4))
        p, pushed = (yield before, p), np.zeros_like(p)
        for _ in range(method.iterations):
            if scene.colliders and method.iterations > 1:  # on positions without what colliders did to them so far
                bare = p - pushed
                p = np.where(free, _collided(fine, before, bare, (bare - before) / h, number)[0], bare)
                pushed = p - bare
            for sweep, (_, order) in zip(sweeps, bodies, strict=True):
                for members in order:
                    sweep.project(members, p, "blocks" if method.rows == "blocks" else "rows")
            for item, multiplier in zip(cloth, multipliers, strict=True):
                xpbd_mesh.project(item, p, before, multiplier, inverse_mass, h)
            for joint, multiplier in zip(joints, joint_multipliers, strict=True):
                joint.project(p, multiplier, inverse_mass, h)
            if touching is not None:
                p = surface_contacts.project(scene.contact, touching, before, p, inverse_mass, sums)
            p = yield before, p
        p = p - pushed
        v = np.where(free, (p - before) / h, 0.0)
        if scene.colliders:
            position, velocity = _collided(fine, before, p, v, number)
            p, v = np.where(free, position, p), np.where(free, velocity, 0.0)
    return p, v


def _collided(
    scene: Scene, before: np.ndarray, position: np.ndarray, velocity: np.ndarray, number: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position, velocity) (particles, 3) after the colliders of substep `number`, of `method.dt` s."""
    state = before[None], position[None], velocity[None]
    settled, answered = cloth_colliders.collide(scene, *state, number, in_place=True)
    return settled[0], answered[0]
