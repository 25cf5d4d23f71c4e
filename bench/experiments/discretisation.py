"""Effect of the triangulation of a sheet: one diagonal direction in every cell, or alternating diagonals.

A square sheet that hangs from its four corners is its own mirror image. Cut along one diagonal it is not: along that
diagonal the edges resist, across it only the sides of the cells do. Two numbers are stored as a finding: how far the
sheet at rest is from its mirror image, and the ratio of its stiffness against a stretch along the diagonals to that
across them, whose exact value follows from the edges alone (see `exact_ratio`).
"""

from __future__ import annotations

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.measure.costs_timing import Measures
from softlab.bench.measure.experiment import described, source_hash
from softlab.bench.measure.items import Finding
from softlab.model.core.build import rest_positions
from softlab.model.core.simulation import State
from softlab.model.position_based.mesh_constraints import mesh_energy
from softlab.model.scene.scene import Scene

FINDING = "discretisation"
BIAS, RATIO, SAG = "finding_bias", "finding_ratio", "finding_sag"  # spacings; dimensionless; m
DIAGONALS = ("one", "alternating")
SIDE = 25  # masses: odd, so that alternating diagonals are their own mirror image
STEPS, DT, SUBSTEPS = 240, 1 / 60, 20
STRETCH = 1e-4


def sheet(diagonals: str, side: int = SIDE) -> Scene:
    """Return 1 m^2 of cloth, pinned at its corners, initially flat; its damper brings it to rest within a second."""
    last = side - 1
    mass = 0.2 / side**2
    return Scene(
        {
            "title": f"Sheet of {'one diagonal' if diagonals == 'one' else 'alternating diagonals'}",
            "mesh": {
                "shape": "sheet", "rows": side, "columns": side, "spacing": 1 / last, "diagonals": diagonals, "mass": mass,
                "placement": "flat", "pinned": [[0, 0], [0, last], [last, 0], [last, last]], "origin": [-0.5, 0.0, -0.5],
            },
            "structural": {"stiffness": 50.0},
            "bending": {"stiffness": 1e-5, "model": "isometric"},
            "damping": {"coefficient": 4.0 * mass},
            "gravity": {},
            "method": {"solver": "xpbd", "dt": DT, "substeps": SUBSTEPS},
        },
        f"sheet-{diagonals}",
    )  # fmt: skip


def mirrored(position: np.ndarray, side: int = SIDE) -> np.ndarray:
    """Return the sheet's mirror image, left and right exchanged: (particles, 3)."""
    p = position.reshape(side, side, 3)[:, ::-1] * [-1.0, 1.0, 1.0]
    return p.reshape(-1, 3)


def bias(position: np.ndarray, side: int = SIDE) -> float:
    """Return the largest distance from a mass to its mirror image, in spacings."""
    apart = np.linalg.norm(position - mirrored(position, side), axis=1)
    return float(apart.max()) * (side - 1)


def stretch_ratio(scene: Scene) -> float:
    """Return the ratio of edge energies: stretched along the falling diagonals over stretched along the rising ones."""
    rest = rest_positions(scene.grid)
    energy = []
    for across in (1.0, -1.0):  # rows go along +z
        direction = np.array([1.0, 0.0, across]) / np.sqrt(2)
        energy.append(mesh_energy(scene, rest + STRETCH * np.outer(rest @ direction, direction), "structural"))
    return energy[0] / energy[1]


def exact_ratio(diagonals: str, side: int = SIDE) -> float:
    """Return the same ratio for small strains e.

    An edge of length L at the angle a to the stretch stores k/2 (L e cos^2 a)^2, which is k/2 s^2 e^2 times 1/4 for a
    side, 2 for a diagonal along it and 0 for one across.
    """
    cells, sides = (side - 1) ** 2, 2 * side * (side - 1) / 4
    falling = cells if diagonals == "one" else (cells + cells % 2) // 2
    return (sides + 2 * falling) / (sides + 2 * (cells - falling))


def at_rest(diagonals: str, backend: str) -> State:
    """Return the sheet's state after STEPS, in float64."""
    with open_simulation(sheet(diagonals), backend, precision="float64") as simulation:
        simulation.advance(STEPS)
        return simulation.state()


def experiments(backend: str) -> list[Finding]:
    """Return one experiment for each triangulation on the backend."""
    all_experiments = []
    for diagonals in DIAGONALS:
        scene = sheet(diagonals)

        def measure(diagonals: str = diagonals, scene: Scene = scene) -> Measures:
            position = at_rest(diagonals, backend).position
            return {
                BIAS: (bias(position), "spacing", "largest distance of a mass from its mirror image"),
                SAG: (float(-position[:, 1].min()), "m", None),
                RATIO: (stretch_ratio(scene), "", f"exact for small strains: {exact_ratio(diagonals):g}"),
            }

        description = described(scene, backend, FINDING, precision="float64", diagonals=diagonals)
        all_experiments.append(Finding(BIAS, description, f"{source_hash(backend)}-discretisation-1", measure))
    return all_experiments
