"""Projections of position-based constraints, one file per constraint: data for the executor of each backend.

Each has a formula `project(points, before, weights, values, multipliers, constants)` -> (points, multipliers).
`points`: the constraint's corners, each a tuple x, y, z [m]. `before`: the same corners when the substep began (read
only by a damper). `weights`: the corners' weights. `values`: the numbers of this one constraint. `multipliers`: its
multipliers [m] so far in this substep. `constants`: the common constants of all constraints of its kind (compliance,
damping, stiffening), see model/formulas/distance.py. How many of each there are: model/particles/constraints.py, and
MODELS in model/position_based/mesh_constraints.py. M. Macklin et al., "XPBD", MIG 2016, algorithm 1, lines 7 to 9.
"""
