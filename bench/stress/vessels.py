"""The levels of water in two communicating vessels (F10)."""

from __future__ import annotations

import numpy as np

from softlab.bench.stress.trial import Check, Trial
from softlab.model.tables.cloth import Box, Plane

LEVELLED = 6.0  # s: simulated time until the levels are measured
PERIODS = 2  # periods of their oscillation over which levels are averaged
BELOW, OFF = "deepest below the floor", "difference of levels, of a rest distance"
BIAS = "height off the volume's, of a rest distance"


def levels_out(trial: Trial) -> list[Check]:
    """F10: water in two vessels that are connected below, all of it in one of them at first.

    In the end it has the same level in both, that of its volume, to a fraction of a layer. It oscillates with the
    period of a column as long as the path between the surfaces (Torricelli), over which levels are averaged; nothing
    passes a wall.
    """
    scene = trial.scene
    fluid_set, wall = scene.fluid_set, scene.parts_of(Box)["wall"]
    middle, half = wall.center[0], wall.half_size[0]
    right, gap = scene.parts_of(Plane)["right"].point[0], wall.center[1] - wall.half_size[1]
    each = right - middle - half
    level = fluid_set.particle_count * fluid_set.lattice.volume / (2 * each) - gap * half / each
    period = 2 * np.pi * np.sqrt((2 * level + 2 * half + each) / 2 / 9.81)
    begin, levels, lowest = trial.steps(LEVELLED), [], 0.0
    for state in trial.watch(range(begin, begin + trial.steps(PERIODS * period), 4)):
        place = state.position.astype(np.float64)
        lowest = min(lowest, float(place[:, 1].min()))
        sides = place[place[:, 0] < middle - half], place[place[:, 0] > middle + half]
        levels.append([len(side) * fluid_set.lattice.volume / each for side in sides])
    heights = np.mean(levels, axis=0)
    return [
        Check(OFF, float(abs(heights[0] - heights[1]) / fluid_set.spacing), "", "<", 0.5),
        Check(BIAS, float(np.abs(heights - level).max() / fluid_set.spacing), "", "<", 0.5),
        Check(BELOW, -lowest, "m", "<", 1e-6),
    ]
