"""The bar of `softlab tetrahedra`: its scene, and its rest state and first half vibration without a solver of the lab.

Both references are computed on the same mesh. Gravity grows with Young's modulus, so the rest state is the same for all
moduli, and frequencies grow with the root of the modulus: both are computed once per mesh, and stored among the
references of the user's cache, each as soon as it is made; a rest state that was interrupted is continued.
"""

from __future__ import annotations

import hashlib
from functools import cache
from math import pi, sqrt
from pathlib import Path

import numpy as np

from softlab.bench.reference.cache import cached_arrays, sources
from softlab.bench.reference.finite_elements import Body, mode_shapes
from softlab.bench.reference.finite_elements_newton import nonlinear_static
from softlab.model.base.disk_cache import cache_folder, write_arrays
from softlab.model.base.table import Table, Tables
from softlab.model.scene.scene import Scene

LENGTH, SIDE, DENSITY, POISSON = 1.0, 0.1, 1000.0, 0.3  # m, m, kg/m^3
WEIGHT = 0.1 / 1e6  # gravity [m/s^2] per Pa of Young's modulus
SHEAR = 0.849673  # fraction of a square section's area that resists shear, at this Poisson's ratio
FRAME = 1 / 60  # s
MODES = 16  # number of lowest modes, which the motion of the tip consists of
BLOCKS = "xpbd blocks"  # a name of SETTINGS: position-based, the element as one block
SECOND = "newton order 2"  # likewise: of second order in time
REFERENCE = 1e6  # Pa: of the bars that references are made of

_MASSES: dict[int, float] = {}  # kg: mass of a particle by voxels across, so that a bar is not cut again to know it


def setting_of(method: Tables) -> str:
    """Return the name in SETTINGS of a table `method`."""
    if method.get("rows") == "blocks":
        return BLOCKS
    return SECOND if method.get("order") == 2 else str(method["solver"])


def cantilever(across: int, young: float, solver: str, substeps: int, iterations: int) -> Scene:
    """Return the bar, fixed at its left end, critically braked for its first bending vibration."""
    beam = {
        "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [LENGTH, SIDE, SIDE]}, "edge": SIDE / across,
        "young_modulus": young, "poisson_ratio": POISSON, "density": DENSITY, "pinned": ["left"],
    }  # fmt: skip
    method: Table = {"solver": solver.split()[0], "dt": FRAME, "substeps": substeps, "iterations": iterations}
    if solver == BLOCKS:
        method["rows"] = "blocks"
    if solver == SECOND:
        method["order"] = 2
    tables = {"beam": beam, "gravity": {"acceleration": WEIGHT * young}, "method": method}
    if across not in _MASSES:
        _MASSES[across] = Scene(tables, "cantilever").grid.mass
    braking = 2 * 2 * pi * bending_frequency(young) * _MASSES[across]
    return Scene(tables | {"damping": {"coefficient": braking}}, "cantilever")


def bending_frequency(young: float) -> float:
    """First bending frequency [Hz] of the clamped bar, by Euler and Bernoulli: 1.8751^2 / (2 pi L^2) sqrt(E I / (rho
    A)).
    """
    return float(1.8751040687**2 / (2 * pi * LENGTH**2) * sqrt(young * SIDE**2 / (12 * DENSITY)))


def continuum_sag(young: float, poisson: float = POISSON) -> float:
    """Sag of the tip [m], q L^4 / (8 E I) + q L^2 / (2 kappa G A), with q the weight per metre."""
    area, second = SIDE**2, SIDE**4 / 12
    load, shear = DENSITY * area * WEIGHT * young, young / (2 * (1 + poisson))
    return load * LENGTH**4 / (8 * young * second) + load * LENGTH**2 / (2 * SHEAR * shear * area)


def sag(scene: Scene, position: np.ndarray) -> float:
    """Return the downward displacement [m] of the free end: the mean of its vertices."""
    rest = scene.tetrahedra_set.position
    end = rest[:, 0] > rest[:, 0].max() - 1e-6 * LENGTH
    return float((rest[end, 1] - position[end, 1]).mean())


def _bar(across: int) -> tuple[Scene, np.ndarray]:
    """Return the bar that references are made of, and a mask of its fixed particles."""
    scene = cantilever(across, REFERENCE, "xpbd", 1, 1)
    fixed = np.zeros(scene.tetrahedra_set.particle_count, bool)
    fixed[scene.tetrahedra_set.pinned_vertices] = True
    return scene, fixed


def _file(what: str, across: int) -> Path:
    """Return the file of a reference of a mesh in the user's cache."""
    tetrahedra_set = _bar(across)[0].tetrahedra_set
    mesh = tetrahedra_set.position.tobytes() + tetrahedra_set.tetrahedra.tobytes() + tetrahedra_set.masses.tobytes()
    parameters = f"{what} {across} {WEIGHT} {POISSON} {DENSITY} {REFERENCE} {MODES} ".encode()
    key = hashlib.sha256(parameters + mesh + sources()).hexdigest()[:16]
    return cache_folder("references") / f"cantilever-{key}.npz"


def lacking(across: int) -> list[str]:
    """Return which references of a mesh the user's cache lacks, which have to be made: `modes`, `rest`."""
    return [what for what in ("modes", "rest") if not _file(what, across).exists()]


@cache
def exact_rest(across: int) -> np.ndarray:
    """Return the rest state of the bar on its own mesh, for any solver and Young's modulus: (particles, 3) [m]."""
    scene, fixed = _bar(across)
    mesh = scene.tetrahedra_set

    shapes = {"position": mesh.position.shape}
    begun = _file("rest begun", across)

    def make() -> dict[str, np.ndarray]:
        gravity = 0.0, -WEIGHT * REFERENCE, 0.0
        start = cached_arrays(begun, shapes, lambda: {"position": mesh.position})["position"]
        body = Body.of(mesh.position, mesh.tetrahedra, "fixed-corotated", REFERENCE, POISSON)
        position = nonlinear_static(
            body, fixed, gravity=gravity, density=DENSITY, start=start, watch=lambda x: write_arrays(begun, {"position": x}),
        )  # fmt: skip
        begun.unlink(missing_ok=True)
        return {"position": position}

    return cached_arrays(_file("rest", across), shapes, make)["position"]


@cache
def _modes(across: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (frequency (m,) [Hz], shapes (m, particles, 3)) of the MODES lowest modes."""
    scene, fixed = _bar(across)
    mesh = scene.tetrahedra_set

    def make() -> dict[str, np.ndarray]:
        modes = mode_shapes(mesh.position, mesh.tetrahedra, REFERENCE, POISSON, DENSITY, fixed, MODES)
        return dict(zip(("frequency", "shapes"), modes, strict=True))

    shapes = {"frequency": (MODES,), "shapes": (MODES, *mesh.position.shape)}
    arrays = cached_arrays(_file("modes", across), shapes, make)
    return arrays["frequency"], arrays["shapes"]


@cache
def exact_drop(across: int, young: float) -> tuple[int, float]:
    """Return (frames to half of the first period, the tip's displacement then [m]) after release from the rest shape.

    The displacement is the sum over the modes of phi (phi' M g) / (phi' M phi w^2) (1 - cos w t).
    """
    scene, _ = _bar(across)
    mesh = scene.tetrahedra_set
    frequency, shapes = _modes(across)
    frequency = frequency * sqrt(young / REFERENCE)
    frames = max(1, round(0.5 / frequency[0] / FRAME))
    mass, w = mesh.masses, 2 * pi * frequency
    push = -WEIGHT * young * (shapes[:, :, 1] @ mass) / (np.einsum("mpk,p->m", shapes**2, mass) * w**2)
    moved = np.einsum("m,mpk->pk", push * (1 - np.cos(w * frames * FRAME)), shapes)
    return frames, sag(scene, mesh.position + moved)
