"""Projections of position-based constraints, one file a constraint: data for the executor of each backend.

A factory `make(real, compiled, **flags)` returns `project(points, before, weights, values, multipliers, constants)` ->
(points, multipliers) as SimpleNamespace: a constraint's corners `points` (each a tuple x, y, z [m]) before and after, where
they were when the substep began (`before`; only a damper asks), their `weights`, the numbers of this one constraint
(`values`), its multipliers [m] so far in this substep, and what all of its kind share: `constants` (compliance, damping,
stiffening), see model/formulas/distance.py. How many of each there are: model/core/constraints.py, and MODELS in
model/xpbd/mesh_constraints.py.

M. Macklin et al., "XPBD", MIG 2016, algorithm 1, lines 7 to 9.
"""
