"""Tetrahedra that are turned inside out, without a load that keeps them so, find their shape again: every material and
solver."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.contact.shortfalls import inverted
from softlab.model.core.simulation import State
from softlab.model.formulas.constraints.tetrahedron import MATERIALS
from softlab.model.scene.scene import Scene

EDGE = 0.1  # m
METHODS: dict[str, dict[str, Any]] = {
    "scalar": {"solver": "xpbd", "substeps": 4}, "blocks": {"solver": "xpbd", "rows": "blocks", "substeps": 4},
    "vbd": {"solver": "vbd", "iterations": 10}, "newton": {"solver": "newton", "iterations": 4},
}  # fmt: skip


def bodies(method: str) -> Scene:
    """A cube of two voxels a side of each material, apart from one another."""
    materials = [
        name for name in MATERIALS if (method, name) != ("blocks", "neo-hookean")
    ]  # which are refused together
    cubes = {
        name: {
            "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [2 * EDGE] * 3}, "edge": EDGE, "material": name,
            "young_modulus": 1e5, "poisson_ratio": 0.4, "damping": 0.01, "origin": [float(n), 0.0, 0.0],
        }
        for n, name in enumerate(materials)
    }  # fmt: skip
    return Scene(cubes | {"method": {"dt": 1 / 60} | METHODS[method]}, "cubes")


@pytest.mark.parametrize(
    "method", [name if name == "scalar" else pytest.param(name, marks=pytest.mark.rest) for name in METHODS]
)
@pytest.mark.parametrize("how", ["a corner through its cube", "mirrored", "flat"])
def test_what_is_inside_out_recovers(method: str, how: str) -> None:
    scene = bodies(method)
    found = scene.tetrahedra_set
    first = np.append(found.first_particle, found.particle_count)
    with open_simulation(scene, precision="float64", math="exact", threads=1) as simulation:
        begin = simulation.state()
        position = begin.position.copy()
        for a, b in pairwise(first):
            if how == "mirrored":
                position[a:b, 0] = 2 * position[a:b, 0].mean() - position[a:b, 0]
            elif how == "flat":
                position[a:b, 1] = position[a:b, 1].mean()
            else:
                middle = position[a:b].mean(axis=0)
                position[a] = middle - 0.4 * (position[a] - middle)
        assert how == "flat" or inverted(position[found.tetrahedra]) >= len(found.parts)
        simulation.load(State(position, np.zeros_like(position), begin.inverse_mass, 0.0, 0))
        for _ in range(12):
            simulation.advance(10)
            state = simulation.state()
            if inverted(state.position[found.tetrahedra]) == 0:
                break
    assert inverted(state.position[found.tetrahedra]) == 0
