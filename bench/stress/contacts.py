"""Hard cases B18 and B19: a pile of layers, and two layers in one place. bench/stress/trial.py tells what a law returns.

The row B18 asks for eight sheets; a scene has one, so that it is one strip folded into eight layers. B19's thickness is the
sheet's spacing, the largest that a scene may have: near the fold each contact keeps no more than the flat sheet has there.
"""

from __future__ import annotations

import numpy as np

from bench.reference import mass_spring as reference
from bench.stress.trial import Check, Trial
from model.contact.penetration import measure

SECONDS = 10.0
STILL_SHARE = 1e-3  # of the largest kinetic energy
GAP_SHARE = 0.8  # of the thickness


def comes_to_rest_in_layers(trial: Trial) -> list[Check]:
    """After 10 s the masses are nearly still, no two layers are much nearer than the thickness, and no edge goes through a
    triangle. What contacts of masses with triangles do not see, edges that come near each other, is told."""
    grid, part = trial.scene.grid, trial.scene.self_collision
    assert part is not None
    peak, energy = 0.0, 0.0
    with trial.open(trial.start(reference.start(trial.scene)[0])) as simulation:
        for _ in range(trial.steps(SECONDS)):
            trial.advance(simulation, 1)
            energy = grid.mass / 2 * float((simulation.read("velocity").astype(np.float64) ** 2).sum())
            peak = max(peak, energy)
        state = trial.look(simulation)
    found = measure(grid.rows, grid.columns, grid.spacing, state.position, part.thickness)
    return [
        Check("kinetic energy over its peak", energy / peak, "", "<", STILL_SHARE),
        Check("smallest gap over the thickness", found.min_gap / part.thickness, "", ">", GAP_SHARE),
        Check("edges through triangles", found.crossings, "", "<", 1),
        Check("pairs of edges that contacts miss", found.edge_misses, ""),
        Check("smallest gap of edges over the thickness", found.min_edge_gap / part.thickness, ""),
    ]
