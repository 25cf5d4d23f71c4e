"""The clusters' arrays for their material on the CPU: shape tables, plastic strain, damping, rigid motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.cpu_backend.shape_matching.layout import SCATTERED, Layout
from softlab.cpu_backend.shape_matching.shapes import ENTRIES
from softlab.model.assets.clusters import Clusters, whole_clusters
from softlab.model.formulas.shape_matching.couple import SPIN
from softlab.model.formulas.shape_matching.deformation import SHAPE
from softlab.model.formulas.shape_matching.pace import MOTION
from softlab.model.scene.method import Method
from softlab.model.shape_matching.cluster_tables import damping_factors, shape_table, shaping
from softlab.model.shape_matching.rigid_motion import goal_slack
from softlab.model.shape_matching.rigid_rebound import rebound_limits


class ClusterArrays:
    """The clusters' arrays.

    `steps`: those of the kernels for the scene's `parts`; `look`: the same for reading the state, whose strain is
    discarded; `plastic`: the state's, flat, ENTRIES per cluster, empty without plasticity; `travel`: see particles.py,
    empty without rigid bodies; `couples`: see couples.py, empty without friction that turns clusters; `touched`: both,
    the arrays that contacts change besides positions.
    """

    def __init__(self, clusters: Clusters, layout: Layout, parts: frozenset[str], real: Any):
        self._clusters, self._of_own = clusters, layout.of_own
        self.plastic = np.zeros(ENTRIES * clusters.count if "plastic" in parts else 0, real)
        self._shapes = np.zeros(SHAPE * clusters.count if shaping(parts) else 0, real)
        self._slowing = np.zeros(len(layout.of_own) if "cluster_damping" in parts else 0, real)
        steps: tuple[Any, ...] = layout.arrays
        look: tuple[Any, ...] = layout.arrays
        if shaping(parts):
            steps = (*steps, self._shapes, self.plastic, self.plastic)
            look = (*look, self._shapes, self.plastic, np.zeros_like(self.plastic))
        if "cluster_damping" in parts:
            damping = (*layout.own[:2], self._slowing, np.zeros(MOTION * clusters.count, real))
            steps, look = (*steps, *damping), (*look, *damping)
        whole = whole_clusters(clusters)
        factors, kinds = whole[clusters.owner][layout.of_own].astype(real), layout.kinds(whole)
        if parts & {"rigid-rebound", "rigid-bounce"}:
            limits, struck = rebound_limits(clusters).astype(real), np.zeros(3 * layout.count, real)
            scales = np.zeros(3 * layout.count, real)
            motions = np.zeros(MOTION * clusters.count, real)
            rebounds = (*layout.own[:2], factors, motions, limits, struck, scales, kinds)
            steps, look = (*steps, *rebounds), (*look, *rebounds)
        self.travel = np.zeros(4 * layout.count if "rigid-motion" in parts else 0, real)
        if "rigid-motion" in parts:
            self.travel[3 * layout.count + layout.slots] = goal_slack(clusters, real)
            motions = np.zeros(MOTION * clusters.count, real)
            scattered = np.array([(kinds == SCATTERED).any()])
            moving = (*layout.own[:2], factors, motions, kinds, self.travel, scattered)
            steps, look = (*steps, *moving), (*look, *moving)
        self.couples = np.zeros(3 * layout.count if "couples" in parts else 0, real)
        if "couples" in parts:
            parts_of = clusters.shares[layout.of_own].astype(real)
            turning = (*layout.own[:2], parts_of, np.zeros(SPIN * clusters.count, real), self.couples)
            steps, look = (*steps, *turning), (*look, *turning)
        self.touched, self.steps, self.look = (self.travel, self.couples), steps, look

    def change(self, method: Method) -> None:
        """Update the tables that depend on the length of a substep."""
        h = method.dt / method.substeps
        if len(self._shapes):
            self._shapes[:] = shape_table(self._clusters, h, method.iterations).reshape(-1)
        if len(self._slowing):
            self._slowing[:] = damping_factors(self._clusters, h)[self._of_own]
