"""The clusters' arrays for their material on the CPU: shape tables, plastic strain, damping, rigid motion."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.shape_matching.arrays import Couples, Damping, Rebound, RigidMotion, Shapes
from softlab.cpu_backend.shape_matching.layout import SCATTERED, Layout, clusters_of_particles, entries_of
from softlab.cpu_backend.shape_matching.shapes import ENTRIES
from softlab.model.assets.clusters import Clusters, whole_clusters
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching.couple import SPIN
from softlab.model.formulas.shape_matching.deformation import SHAPE
from softlab.model.formulas.shape_matching.pace import MOTION
from softlab.model.shape_matching.cluster_tables import damping_factors, shape_table, shaping
from softlab.model.shape_matching.rigid_motion import goal_slack
from softlab.model.shape_matching.rigid_rebound import rebound_limits
from softlab.model.tables.method import Method


class ClusterMaterial:
    """The clusters' arrays.

    `steps`: those of the kernels for the scene's `parts`; `look`: the same for reading the state, whose strain is
    discarded; `plastic`: the state's, flat, ENTRIES per cluster, empty without plasticity; `travel`: see particles.py,
    empty without rigid bodies; `couples`: see couples.py, empty without friction that turns clusters; `touched`: both,
    the arrays that contacts change besides positions.
    """

    def __init__(self, clusters: Clusters, every: Clusters, layout: Layout, parts: frozenset[str], real: Real):
        self._clusters, self._of_particle_entry = clusters, layout.of_particle_entry
        self.plastic: np.ndarray = np.zeros(ENTRIES * clusters.count if "plastic" in parts else 0, real)
        self._shapes: np.ndarray = np.zeros(SHAPE * clusters.count if shaping(parts) else 0, real)
        self._slowing: np.ndarray = np.zeros(len(layout.of_particle_entry) if "cluster_damping" in parts else 0, real)
        motions: np.ndarray
        steps, motions = layout.arrays, np.zeros(MOTION * clusters.count, real)
        if shaping(parts):
            steps = steps._replace(shapes=Shapes(self._shapes, self.plastic, self.plastic))
        starts, owners, _ = layout.of_particle
        if "cluster_damping" in parts:
            steps = steps._replace(damping=Damping(starts, owners, self._slowing, motions.copy()))
        whole = whole_clusters(clusters)
        factors, kinds = whole[clusters.owner][layout.of_particle_entry].astype(real), layout.kinds(whole)
        if parts & {"rigid-rebound", "rigid-bounce"}:
            limits: np.ndarray = rebound_limits(clusters).astype(real)
            impulses: np.ndarray
            scales: np.ndarray
            impulses, scales = (np.zeros(3 * layout.count, real) for _ in range(2))
            steps = steps._replace(
                rebound=Rebound(starts, owners, factors, motions.copy(), limits, impulses, scales, kinds)
            )
        self.travel: np.ndarray = np.zeros(4 * layout.count if "rigid-motion" in parts else 0, real)
        if "rigid-motion" in parts:
            self.travel[3 * layout.count + layout.slots] = goal_slack(clusters, real)
            scattered = np.array([(kinds == SCATTERED).any()])
            steps = steps._replace(
                rigid=RigidMotion(starts, owners, factors, motions.copy(), kinds, self.travel, scattered)
            )
        self.couples: np.ndarray = np.zeros(3 * layout.count if "couples" in parts else 0, real)
        if "couples" in parts:
            steps = steps._replace(couples=self._coupled(every, layout, real))
        self.touched, self.steps, self.view_steps = (self.travel, self.couples), steps, steps
        if isinstance(steps.shapes, Shapes):
            self.view_steps = steps._replace(shapes=steps.shapes._replace(plastic_after=np.zeros_like(self.plastic)))

    def _coupled(self, every: Clusters, layout: Layout, real: Real) -> Couples:
        """Return the arrays of `every` cluster that friction turns, windows of lattices included."""
        entries, (starts, owners, _), order = layout.arrays, layout.of_particle, layout.of_particle_entry
        if every.count > self._clusters.count:
            entries, _ = entries_of(every, layout.slots, real)
            starts, owners, order = clusters_of_particles(every, layout.slots, layout.count)
        spins: np.ndarray
        weights, spins = every.weights[order].astype(real), np.zeros(SPIN * every.count, real)
        return Couples(starts, owners, weights, spins, self.couples, entries)

    def change(self, method: Method) -> None:
        """Update the tables that depend on the length of a substep."""
        h = method.dt / method.substeps
        if len(self._shapes):
            self._shapes[:] = shape_table(self._clusters, h, method.iterations).reshape(-1)
        if len(self._slowing):
            self._slowing[:] = damping_factors(self._clusters, h)[self._of_particle_entry]
