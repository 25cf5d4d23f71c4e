"""Bodies of tetrahedra on CUDA, position-based: two constraints a tetrahedron, a thread for each tetrahedron of a colour, or
for each voxel.

M. Macklin et al., "XPBD", MIG 2016, algorithm 1; M. Macklin et al., "Small Steps in Physics Simulation", SCA 2019. Launches
are a mesh's (xpbd/mesh.py), what a tetrahedron does is model/formulas/constraints/tetrahedron.py.
"""

from __future__ import annotations

import numpy as np

from gpu_backend.xpbd.mesh import MeshPositionBased
from model.core.constraints import ConstraintSet, Projection
from model.core.plan import Plan
from model.scene.scene import Scene
from model.tetrahedra.constraints import constraint_sets, projections_of, tetrahedra_plan
from model.tetrahedra.tables import surface_lists


class Tetrahedra(MeshPositionBased):
    """See model/core/simulation.py for the contract. `threads` is the number of threads a block."""

    what, named = "tetrahedral bodies", "tetrahedral_body"

    def _plan_of(self, scene: Scene, live: frozenset[str]) -> Plan:
        return tetrahedra_plan(scene, live)

    def _constraints(self) -> tuple[list[ConstraintSet], tuple[Projection, ...]]:
        return list(constraint_sets(self.scene)), projections_of(self.plan.parts)

    def _surface_lists(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return surface_lists(self.scene.tetrahedra_set)
