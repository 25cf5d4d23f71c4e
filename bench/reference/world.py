"""Bodies of clusters, tetrahedral bodies, cloths and a fluid in one world, in slow, plain NumPy float64: the reference.

Each member moves as in its own reference (shape_matching.py, tetrahedra_cloth.py, xpbd_mesh.py), which pauses after its
prediction and after every iteration. Then contacts between members are projected as contact/surface_contacts.py projects
contacts: particles of bodies, as balls, against every triangle of the others. A ball keeps its radius plus half of the
distance of surfaces. A fluid moves as in bench/reference/coupled/fluid_solids.py, after the solids and before their
contacts.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from softlab.bench.reference import shape_matching, tetrahedra_cloth, xpbd_mesh
from softlab.bench.reference.contact import surface_contacts
from softlab.bench.reference.contact.self_contacts import VertexContacts
from softlab.bench.reference.coupled.fluid_solids import FluidAmongSolids
from softlab.bench.reference.steps import Motion
from softlab.model.contact.attachments import attachment_sets
from softlab.model.scene.scene import Scene
from softlab.model.world.plan import coupled
from softlab.model.world.solids import solids_of


@dataclass
class Surfaces:
    """Surfaces of all members, in the world's particle numbers.

    `triangles` (t, 3); `body` (particles,), -1 for balls, which belong to none; `is_closed` (bodies,); `gaps`
    (particles,) [m]: distance from triangles; `balls` (n,).
    """

    triangles: np.ndarray
    body: np.ndarray
    is_closed: np.ndarray
    gaps: np.ndarray
    balls: np.ndarray


def _surfaces(scene: Scene, distance: float) -> Surfaces:
    slices = scene.world_set.slices()
    count = slices["fluid"].start if "fluid" in slices else scene.world_set.particle_count  # the fluid comes last
    body, gaps, triangles = np.full(count, -1), np.full(count, distance), [np.zeros((0, 3), int)]
    closed: list[bool] = []
    for name, member in scene.members.items():
        first = slices[name].start
        if name == "bodies":
            body_set = member.body_set
            radii = np.array([member.bodies[copy.name].contact_radius for copy in body_set.copies])
            gaps[slices[name]] = radii[body_set.body] + distance / 2
        elif name == "fluid":
            continue
        elif name == "cloth":
            body[slices[name]] = len(closed)
            triangles.append(member.grid.triangles().astype(int) + first)
            closed.append(False)
        else:
            mesh = member.tetrahedra_set
            ends = [*mesh.first_particle.tolist(), mesh.particle_count]
            for number, (start, stop) in enumerate(pairwise(ends)):
                body[first + start : first + stop] = len(closed)
                closed.append(number < len(mesh.parts))
            attached = [rows.corners.ravel() for rows in attachment_sets(mesh) if rows.corners.shape[1] > 1]
            free = ~np.isin(mesh.surface, np.concatenate([[], *attached])).any(axis=1)
            triangles.append(mesh.surface[free].astype(int) + first)
    return Surfaces(np.concatenate(triangles), body, np.array(closed), gaps, np.flatnonzero(body < 0))


def find(scene: Scene, surfaces: Surfaces, before: np.ndarray, predicted: np.ndarray) -> VertexContacts:
    """Return the possible contacts within a substep from `before` to `predicted` (particles, 3) [m]."""
    assert scene.contact is not None
    vertex, triangle = (
        a.ravel() for a in np.meshgrid(surfaces.balls, np.arange(len(surfaces.triangles)), indexing="ij")
    )
    push = scene.contact.separation_speed * scene.method.dt / scene.method.substeps
    return surface_contacts.among(
        surfaces.triangles, vertex, triangle, surfaces.body, surfaces.is_closed, surfaces.gaps, push, before, predicted
    )


def _motions(
    scene: Scene, steps: int, position: np.ndarray, velocity: np.ndarray, most: int, distance: float
) -> list[Motion]:
    motions: list[Motion] = []
    for name, member in scene.members.items():
        place = scene.world_set.slices()[name]
        begin = steps, position[place], velocity[place]
        if name == "bodies":
            motions.append(shape_matching.motion(member, *begin))
        elif name == "cloth":
            motions.append(xpbd_mesh.motion(member, *begin, scene.world_set.masses[place]))
        elif name == "tetrahedra":
            motions.append(tetrahedra_cloth.motion(member, *begin, most, distance))
    return motions


def simulate(
    scene: Scene, steps: int, position: np.ndarray, velocity: np.ndarray, most: int, distance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position [m], velocity [m/s]), (particles, 3) float64, after `steps` steps from the given ones.

    `most`: largest number of contacts of a vertex; `distance` [m]: that surfaces keep. Raises SceneError for parts that
    a member's reference does not support.
    """
    weight = 1 / scene.world_set.masses
    weight[scene.world_set.pinned_vertices] = 0
    motions = _motions(scene, steps, position, velocity, most, distance)
    surfaces = _surfaces(scene, distance) if coupled(scene) else None
    slices = [place for name, place in scene.world_set.slices().items() if name != "fluid"]
    weight = weight[: slices[-1].stop]
    fluid = _Fluid(scene, position, velocity) if "fluid" in scene.members else None
    places = [next(motion) for motion in motions]
    ended: list[tuple[np.ndarray, np.ndarray]] = []
    for number in range(steps * scene.method.substeps):
        before, now = (np.concatenate(arrays) for arrays in zip(*places, strict=True))
        touching = find(scene, surfaces, before, now).nearest(most) if surfaces else None
        sums = np.zeros((len(touching.mass) if touching else 0, 4))
        if fluid:
            fluid.begin(number, before, now)
        for _ in range(scene.method.iterations):
            moved = [motion.send(now[place]) for motion, place in zip(motions, slices, strict=True)]
            now = np.concatenate([place for _, place in moved])
            if fluid:
                now = fluid.correct(now)
            if touching is not None:
                now = surface_contacts.project(scene.contact, touching, before, now, weight, sums)
        places = []
        for motion, place in zip(motions, slices, strict=True):
            try:
                places.append(motion.send(now[place]))
            except StopIteration as end:
                ended.append(end.value)
        if fluid:
            fluid.end()
    if fluid:
        ended.append((fluid.position, fluid.velocity))
    positions, speed = (np.concatenate(arrays) for arrays in zip(*ended, strict=True))
    return positions, speed


class _Fluid:
    """Fluid of a world among its solids, whose particles come first."""

    def __init__(self, scene: Scene, position: np.ndarray, velocity: np.ndarray):
        solids, particles = solids_of(scene), scene.world_set.slices()["fluid"]
        self.solids, self.among = solids.particles, FluidAmongSolids(scene.members["fluid"], solids.samples)
        self.position, self.velocity = position[particles], velocity[particles]

    def begin(self, number: int, before: np.ndarray, now: np.ndarray) -> None:
        self.among.begin(number, self.position, self.velocity, before[self.solids], now[self.solids])

    def correct(self, now: np.ndarray) -> np.ndarray:
        """Return the positions of the solids after an iteration of the fluid."""
        corrected = now.copy()
        corrected[self.solids] = self.among.correct(now[self.solids])
        return corrected

    def end(self) -> None:
        self.position, self.velocity = self.among.end()
