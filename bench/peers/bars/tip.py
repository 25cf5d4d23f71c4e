"""Bars of tetrahedra that peers are compared on: the cantilever of `softlab tetrahedra`, released unloaded.

The measured quantity is the displacement of its tip after half of its first vibration. The exact value is known for the
mesh, whatever solves it: by the modes of any material with the same Young's modulus and Poisson's ratio, since the
strains are 1e-3. A peer whose material has another slope at rest is compared with its own law (`by_stress`), and its
difference from the bar's is reported too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import ceil

import numpy as np
from scipy.sparse import diags
from scipy.sparse.linalg import eigsh

from softlab.bench.experiments.tetrahedral.cantilever import POISSON, WEIGHT, cantilever, exact_drop, sag
from softlab.bench.reference.elastic_materials import lame
from softlab.bench.reference.finite_elements import Body, free_coordinates
from softlab.model.scene.scene import Scene

BARS = {"tetrahedra-1e5": (1e5, 4), "tetrahedra-1e6": (1e6, 10), "tetrahedra-1e7": (1e7, 24)}
# word of bench/peers/scenes.py -> Young's modulus [Pa], the lab's substeps per frame, by which its error is below 1 %
NEAR = 0.05  # of the displacement: largest error of a peer that simulates the same scene
ACROSS = (2, 4, 8)  # voxels: 400, 3200, 25 600 tetrahedra
PER_BAR = 50  # tetrahedra of the coarsest bar, one voxel across
FINE = 8  # steps of the explicit reference to one at the stability limit

Stress = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # F, mu, lambda -> first Piola-Kirchhoff stress


def bar_of(young: float, substeps: int) -> Callable[[int, int], Scene]:
    """Make the function that returns the bar, n voxels across, without a brake, neo-Hookean, by the lab's Newton
    method.
    """

    def make(rows: int, columns: int) -> Scene:
        tables = cantilever(rows, young, "newton", substeps, 1).as_dict()
        tables = {name: table for name, table in tables.items() if name != "damping"}
        return Scene(tables, "cantilever").replace({"beam.material": "neo-hookean"})

    return make


def young_of(scene: Scene) -> float:
    """Young's modulus [Pa]."""
    (part,) = scene.tetrahedra_set.parts
    return float(part.young_modulus)


def across_of(scene: Scene) -> int:
    """Number of voxels across."""
    return round((len(scene.tetrahedra_set.tetrahedra) / PER_BAR) ** (1 / 3))


@dataclass(frozen=True)
class Tip:
    """Exact result: after `frames` the tip has the `displacement` [m] downwards; `law`: where it is from."""

    frames: int
    displacement: float
    law: str = "the modes of its mesh"

    def error(self, scene: Scene, position: np.ndarray) -> float:
        """Return the relative error of a state (particles, 3) [m]; infinite if it is not finite."""
        deviation = sag(scene, np.asarray(position, np.float64)) / self.displacement - 1
        return abs(deviation) if np.isfinite(deviation) else float("inf")


def exact_tip(scene: Scene) -> Tip:
    """Return the exact result for the scene's own material."""
    return Tip(*exact_drop(across_of(scene), young_of(scene)))


def _free(scene: Scene) -> np.ndarray:
    mesh = scene.tetrahedra_set
    free = np.ones(mesh.particle_count, bool)
    free[mesh.pinned_vertices] = False
    return free


def lame_of(scene: Scene) -> tuple[float, float]:
    """Return (mu, lambda) [Pa] of the scene's material."""
    mu, lam = lame(young_of(scene), POISSON)
    return float(mu), float(lam)


@cache
def quickest(across: int, young: float) -> float:
    """Angular frequency [1/s] of the mesh's fastest vibration, masses lumped."""
    scene = cantilever(across, young, "xpbd", 1, 1)
    mesh, free = scene.tetrahedra_set, free_coordinates(~_free(scene))
    body = Body.of(mesh.position, mesh.tetrahedra, "corotated", young, POISSON)
    root = diags(1 / np.sqrt(np.repeat(mesh.masses, 3)[free]))
    matrix = root @ body.stiffness()[free][:, free] @ root
    start = np.random.default_rng(0).normal(size=len(free))
    return float(np.sqrt(eigsh(matrix, k=1, which="LM", v0=start, tol=1e-3)[0][0]))


@cache
def by_stress(across: int, young: float, stress: Stress, law: str) -> Tip:
    """Return the exact result for a material with that stress.

    The mesh's motion by velocity Verlet in float64, with FINE times as many steps as are stable.
    """
    scene = bar_of(young, 1)(across, across)
    frames, mesh = exact_drop(across, young)[0], scene.tetrahedra_set
    mu, lam = (np.full(len(mesh.tetrahedra), value) for value in lame_of(scene))
    body = Body.of(mesh.position, mesh.tetrahedra, "neo-hookean", young, POISSON)
    where, free = body.tetrahedra.ravel(), _free(scene)
    end = frames * scene.method.dt
    steps = ceil(FINE * end * quickest(across, young) / 2)
    h, x, v = end / steps, body.rest.copy(), np.zeros_like(body.rest)

    def pull(at: np.ndarray) -> np.ndarray:
        force = np.einsum("m,mij,maj->mai", body.volume, stress(body.deformation(at), mu, lam), body.gradient)
        each = force.reshape(-1, 3)
        total = np.stack([np.bincount(where, each[:, axis], minlength=len(at)) for axis in range(3)], axis=1)
        acceleration = -total / mesh.masses[:, None]
        acceleration[:, 1] -= WEIGHT * young
        return acceleration * free[:, None]

    push = pull(x)
    for _ in range(steps):
        v += h / 2 * push
        x += h * v
        push = pull(x)
        v += h / 2 * push
    return Tip(frames, sag(scene, x), law)


def tetrahedra_refusal(scene: Scene) -> str | None:
    """Return why a peer of a free neo-Hookean body cannot run the scene, or None."""
    if not scene.tetrahedra or scene.method.solver != "newton":
        return "it supports only the free bar of tetrahedra"
    unknown = set(scene.kinds.values()) - {"tetrahedral_body", "gravity", "method"}
    if unknown:
        return f"it has no {', '.join(sorted(unknown))} as the lab means it"
    (part,) = scene.tetrahedra_set.parts
    return None if part.material == "neo-hookean" and part.damping == 0 else "its material is another"
