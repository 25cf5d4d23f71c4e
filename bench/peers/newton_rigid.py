"""Towers of rigid beams in Newton, by its solvers for rigid bodies (XPBD, VBD, Steel).

Boxes of the same size, mass and place, on the same plane, the lab's substeps, contacts searched again in each. The lab
makes a rigid body of particles, so its contacts are between spheres; Newton's are between boxes. Both must agree on
where the beams lie once they have fallen on each other: the particles of a beam are where Newton's box carries them.

Not compared: shape matching, which Newton does not have (its tetrahedra: bars/newton.py); its MuJoCo solver, whose
packages are not among the lab's extras; its semi-implicit Euler, whose contacts are springs that can only be soft at
this step size.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.bench.peers.base import Opened
from softlab.bench.peers.newton_sheet import FromNewton, Model, Newton, load_newton
from softlab.model.core.build import build
from softlab.model.scene.scene import Scene

# N/m, N s/m: VBD's contacts are compliant; a tower sinks by millimetres
CONTACT_STIFFNESS, CONTACT_DAMPING = 1e6, 100.0
KNOWN = {"rigid_body", "contact", "plane", "gravity", "method"}


class NewtonRigid(Newton):
    """A `solver` of Newton with that many iterations, or None for its default."""

    scenes = ("rigid",)

    def __init__(self, backend: str, solver: str, iterations: int | None = None):
        self.solver = f"Solver{solver}"
        self.kind, self.title = f"newton_rigid_{solver.lower()}", f"Newton {solver}"
        super().__init__(backend, iterations)

    def scene_refusal(self, scene: Scene) -> str | None:
        if not scene.bodies:
            return "it supports only rigid bodies"
        unknown = set(scene.kinds.values()) - KNOWN
        if unknown:
            return f"it has no {', '.join(sorted(unknown))} as the lab means it"
        if {body.shape and body.shape.name for body in scene.bodies.values()} != {"beam"}:
            return "it supports only beams"
        return None

    def opened(self, scene: Scene, precision: str) -> Opened:
        return _Towers(scene, self.solver, self.backend, self.iterations)


class _Towers(Model):
    chunks = (4, 2)  # a step has some thousand launches

    def __init__(self, scene: Scene, solver: str, backend: str, iterations: int | None):
        super().__init__(backend)
        body = build(scene)
        self._substeps = scene.method.substeps
        self._h = scene.method.dt / self._substeps
        self._start = body.position.reshape(len(scene.body_set.copies), -1, 3)
        self._rest = self._start - self._start.mean(axis=1, keepdims=True)
        model = self._build(scene)
        self._pipeline = load_newton().CollisionPipeline(model, broad_phase="sap")
        self._contacts = self._pipeline.contacts()
        self._begin(model, solver, (body.position, body.velocity), {"iterations": iterations})

    def _build(self, scene: Scene) -> FromNewton:
        builder = self._builder(-scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0)
        (plane,) = scene.colliders
        beam: Any = next(iter(scene.bodies.values()))
        material = builder.ShapeConfig(
            density=beam.density, mu=plane[1].dynamic_friction, ke=CONTACT_STIFFNESS, kd=CONTACT_DAMPING
        )
        builder.add_ground_plane(cfg=material)
        half = 0.5 * (np.ptp(self._rest[0], axis=0) + scene.body_set.spacing)  # a particle represents a cube
        for particles in self._start:
            where = self._wp.transform(tuple(particles.mean(axis=0).tolist()), self._wp.quat_identity())
            body = builder.add_body(xform=where)
            builder.add_shape_box(body, hx=float(half[0]), hy=float(half[1]), hz=float(half[2]), cfg=material)
        builder.color()
        return builder.finalize(device=self._device)

    def _prepare(self, state: FromNewton) -> None:
        super()._prepare(state)
        self._pipeline.collide(state, self._contacts)

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Move each beam to its particles, as closely as a rigid motion can."""
        self._current = 0
        at, speed = (np.asarray(array, np.float64).reshape(self._rest.shape) for array in (position, velocity))
        middle, linear = at.mean(axis=1), speed.mean(axis=1)
        away, apart = at - middle[:, None], speed - linear[:, None]
        u, _, v = np.linalg.svd(np.einsum("bni,bnj->bij", away, self._rest))
        u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
        squared = np.einsum("bnk,bnk->b", away, away)[:, None, None] * np.eye(3)
        inertia = squared - np.einsum("bni,bnj->bij", away, away)
        spin = np.linalg.solve(inertia, np.cross(away, apart).sum(axis=1)[..., None])[..., 0]
        pose = np.concatenate([middle, _quaternions(u @ v)], axis=1).astype(np.float32)
        motion = np.concatenate([linear, spin], axis=1).astype(np.float32)
        for state in self._states:
            state.body_q.assign(pose)
            state.body_qd.assign(motion)
            load_newton().eval_ik(self._model, state, state.joint_q, state.joint_qd)
        self._solver.reset(self._states[0])
        self.synchronize()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        self.synchronize()
        state = self._states[self._current]
        pose, motion = state.body_q.numpy().astype(np.float64), state.body_qd.numpy().astype(np.float64)
        away = np.einsum("bij,bnj->bni", _rotations(pose[:, 3:]), self._rest)
        position = pose[:, None, :3] + away
        velocity = motion[:, None, :3] + np.cross(motion[:, None, 3:], away)
        return position.reshape(-1, 3).astype(np.float32), velocity.reshape(-1, 3).astype(np.float32)


def _rotations(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (bodies, 3, 3) of unit quaternions (bodies, 4), the real part last."""
    x, y, z, w = quaternion.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _quaternions(rotation: np.ndarray) -> np.ndarray:
    """Return the unit quaternions (bodies, 4), the real part last, of rotations (bodies, 3, 3).

    The eigenvector of the largest eigenvalue of a symmetric matrix (Bar-Itzhack 2000), without special cases.
    """
    r = rotation
    matrix = np.empty((len(r), 4, 4))
    for i in range(3):
        for j in range(3):
            matrix[:, i, j] = r[:, i, j] + r[:, j, i] - (i == j) * np.trace(r, axis1=1, axis2=2)
    antisymmetric = np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=1)
    matrix[:, 3, :3] = matrix[:, :3, 3] = antisymmetric
    matrix[:, 3, 3] = np.trace(r, axis1=1, axis2=2)
    return np.linalg.eigh(matrix)[1][:, :, -1]
