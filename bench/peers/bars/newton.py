"""Bar of tetrahedra in Newton, by its solvers for soft bodies: VBD, XPBD and semi-implicit Euler.

They get the lab's vertices, tetrahedra, lumped masses and pins, and the Lame parameters of Young's modulus and
Poisson's ratio. Their materials (Newton 1.8, the sources of its kernels; its builder calls all of them the Neo-Hookean
one of Smith, de Goes, Kim, "Stable Neo-Hookean Flesh Simulation", ACM TOG 2018):

- VBD: that one without its logarithm, lambda + mu in place of lambda: the lab's `neo-hookean`, number for number.
- Semi-implicit Euler: that one with its logarithm and the parameters as given, which at rest is a material of 3/4 mu and
  lambda - 5/8 mu. It gets 4/3 mu and lambda + 5/6 mu, so that it has the requested material.
- XPBD: mu/2 (|F|^2 - 3)^2 + lambda/2 (J - 1)^2, each square a constraint. The first is of second order in the strain, not
  of first: at rest it only resists a stretch of the trace. A bar of it initially has no bending stiffness, whatever mu, and
  no parameters give the requested material. It is compared with its own law (bench/peers/bars/tip.py).

XPBD adds up the full corrections of all tetrahedra of a vertex at once, times 0.9, as for springs. Semi-implicit Euler
is explicit and undamped, and gets the fewest substeps that the fastest vibration of its mesh allows, with a margin.
"""

from __future__ import annotations

import math

import numpy as np

from softlab.bench.peers.bars.tip import (
    BARS,
    NEAR,
    Tip,
    across_of,
    by_stress,
    lame_of,
    quickest,
    tetrahedra_refusal,
    young_of,
)
from softlab.bench.peers.base import Opened
from softlab.bench.peers.newton_sheet import FromNewton, Model, Newton
from softlab.bench.reference.elastic_materials import cofactor
from softlab.model.core.build import build
from softlab.model.scene.scene import Scene

MOST = 200_000  # tetrahedra: its model is made of Python lists
STABLE = 0.7  # fraction of the longest stable explicit step
SQUARES = "mu/2 (|F|^2 - 3)^2 + lambda/2 (J - 1)^2, its own law"


def squares_stress(gradient: np.ndarray, mu: np.ndarray, lam: np.ndarray) -> np.ndarray:
    """Return the first Piola-Kirchhoff stress of XPBD's law: (..., 3, 3) [Pa]."""
    square = np.einsum("...ij,...ij->...", gradient, gradient) - 3
    swell = np.linalg.det(gradient) - 1
    return (2 * mu * square)[..., None, None] * gradient + (lam * swell)[..., None, None] * cofactor(gradient)


class NewtonTetrahedra(Newton):
    """Bars of tetrahedra by a `solver` of Newton, with `substeps` per frame (None: the fewest that are stable) and
    `iterations` (None for a solver without iterations)."""

    scenes = tuple(BARS)

    def __init__(self, backend: str, solver: str, substeps: int | None = None, iterations: int | None = None):
        self.solver, self.substeps = f"Solver{solver}", substeps
        self.kind, self.title = f"newton_tetrahedra_{solver.lower()}", f"Newton {solver}"
        super().__init__(backend)
        self.iterations = iterations
        if substeps:
            self.name = f"{self.kind}_{substeps}x{iterations}_{backend}"
            self.label = f"{self.title}, {substeps} x {iterations}"

    def scene_refusal(self, scene: Scene) -> str | None:
        return tetrahedra_refusal(scene)

    def refusal(self, scene: Scene) -> str | None:
        reason = self.scene_refusal(scene)
        if reason is None and len(scene.tetrahedra_set.tetrahedra) > MOST:
            return "building its model from Python lists would take minutes"
        return reason

    def bound(self, scene: Scene, precision: str) -> float:
        return NEAR

    def tip(self, scene: Scene) -> Tip | None:
        """Return the exact result of the solver's own law, or None if its law is the scene's."""
        if self.solver != "SolverXPBD":
            return None
        return by_stress(across_of(scene), young_of(scene), squares_stress, SQUARES)

    def opened(self, scene: Scene, precision: str) -> Opened:
        return _Body(scene, self.solver, self.backend, self.substeps, self.iterations)


def stable_substeps(scene: Scene) -> int:
    """Return the stable substeps per frame, an even number, so that the two buffers are back in place after it."""
    return 2 * math.ceil(scene.method.dt * quickest(across_of(scene), young_of(scene)) / 2 / STABLE / 2)


class _Body(Model):
    chunks = (1,)  # frames per graph, each of up to some thousand launches

    def __init__(self, scene: Scene, solver: str, backend: str, substeps: int | None, iterations: int | None):
        super().__init__(backend)
        body = build(scene)
        self._substeps = substeps or stable_substeps(scene)
        if self._substeps % 2:
            raise ValueError("an odd number of substeps leaves the state in the other buffer")
        self._h = scene.method.dt / self._substeps
        how = {"iterations": iterations, "particle_enable_self_contact": False if solver == "SolverVBD" else None}
        self._begin(self._build(scene, body.position, solver), solver, (body.position, body.velocity), how)

    def _build(self, scene: Scene, position: np.ndarray, solver: str) -> FromNewton:
        mesh, (mu, lam) = scene.tetrahedra_set, lame_of(scene)
        if solver == "SolverSemiImplicit":
            mu, lam = 4 / 3 * mu, lam + 5 / 6 * mu
        builder = self._builder(-scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0)
        mass = mesh.masses.copy()
        mass[mesh.pinned_vertices] = 0.0
        builder.add_particles(
            pos=position.tolist(), vel=np.zeros_like(position).tolist(), mass=mass.tolist(), radius=[0.0] * len(mass)
        )
        for corners in mesh.tetrahedra.tolist():
            builder.add_tetrahedron(*corners, mu, lam, 0.0)
        builder.color()
        return self._finalized(builder)
