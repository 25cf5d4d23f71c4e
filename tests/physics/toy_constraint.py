"""A contributor's constraint: edges of a mesh shrink freely, but grow by GROWTH at most (X. Provot, "Deformation Constraints
in a Mass-Spring Model to Describe Rigid Cloth Behaviour", Graphics Interface 1995).

Prints a line of JSON for each run: the largest stretch after a step from a stretched and from a compressed sheet, and
whether its bits are the CPU's. See test_toys.py.
"""

import json
import sys
from dataclasses import replace

import numpy as np

from softlab.model.base.variant import formula
from softlab.model.formulas.constraints.distance import shifted
from softlab.model.formulas.distance import reciprocal, rigid_change
from softlab.model.formulas.lengths import squared_length_3d
from softlab.model.geometry.measures import edge_lengths
from softlab.model.position_based.mesh_constraints import MODELS, Model, edge_strain

GROWTH, STRETCHED, COMPRESSED = 0.01, 1.25, 0.875
LONGEST = 1.0 + GROWTH


@formula
def project(points, before, weights, values, multipliers, constants):
    a, b = points
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    squared, longest, change, scale = squared_length_3d(dx, dy, dz), LONGEST * values[0], 0.0, 0.0
    if squared > longest * longest:
        change, scale = rigid_change(squared, longest, reciprocal(weights[0] + weights[1], constants[2], constants[0]))
    ends = shifted(a, weights[0], -scale, dx, dy, dz), shifted(b, weights[1], scale, dx, dy, dz)
    return ends, (multipliers[0] + change,)


def build(mesh, kind):
    return mesh.edges.edges, edge_lengths(mesh.position, mesh.edges.edges)[:, None]


def violation(position, corners, values):
    return np.maximum(edge_lengths(position, corners) - LONGEST * values[:, 0], 0.0), 1.0


def main() -> None:
    MODELS["structural"] = Model(sys.modules[__name__], 2, 1, 25, build, violation)
    from toy_force import runs

    mesh, method = {"shape": "sheet", "rows": 3, "columns": 3}, {"solver": "pbd", "iterations": 40}
    for simulation, run, same in runs({"mesh": mesh, "structural": {}, "method": method}):
        rest, strains = simulation.state(), []
        for factor in (STRETCHED, COMPRESSED):
            simulation.load(replace(rest, position=factor * rest.position))
            simulation.advance(1)
            strains.append(float(edge_strain(simulation.scene, simulation.read("position")).max()))
        print(json.dumps({"run": run, "strains": strains, "same": same(simulation.read("position"))}))


if __name__ == "__main__":
    main()
