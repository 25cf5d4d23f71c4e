"""Bodies made from meshes: particles, clusters, links and a skin, ready for a solver.

The parameters are those of NVIDIA Flex's flexExtCreateSoftFromMesh and flexExtCreateRigidFromMesh, with units.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from pydantic import Field, ValidationError, model_validator

from softlab.model.assets.baked_body import BakedBody, Report, report_of
from softlab.model.assets.clustering import check, gather, one_cluster
from softlab.model.assets.clusters import Clusters
from softlab.model.assets.material import Material, even
from softlab.model.assets.sampling import sample
from softlab.model.assets.skin import make_skin
from softlab.model.base.errors import SceneError
from softlab.model.base.table import Flag, NotNegative, Part, Positive
from softlab.model.base.words import scene_error
from softlab.model.geometry.mesh import TriangleMesh
from softlab.model.geometry.neighbours import TooMany, close_pairs
from softlab.model.geometry.solid import as_mesh, solid

SPACINGS = 2.0  # of the clusters' centres in particle spacings, unless given
OVERLAP = 1.25  # of their radius in their spacings, unless given
LARGEST_STRAIN = 0.5  # that a body keeps, unless given
DENSITY = 1000.0  # kg/m^3: water's, as jelly's

Fraction = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False, strict=True)]
Limit = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False, strict=True)]  # at 1 a cluster could be flat
MATERIAL = ("linear", "plastic_threshold", "plastic_creep", "plastic_limit", "cluster_damping")  # not of the bake
Meshes = TriangleMesh | tuple[np.ndarray, np.ndarray]
Body = TypeVar("Body", bound="RigidBody")
Binding = tuple[Clusters, np.ndarray, np.ndarray, float]
OVERLAPPING = "parts of the mesh overlap one another, or cross themselves: what is inside any of them is inside"


class RigidBody(Part):
    """A body of particles that are sampled from a closed mesh.

    `volume_sampling`: 0, nothing inside; 1, a lattice of the particle spacing; above 1, gaps are filled from a lattice
    that many times finer. `surface_sampling`: candidates on the surface per square of the spacing; 0, none. Give either
    `density` or `mass`, of the whole body.
    """

    lacks: ClassVar[tuple[str, ...]] = ()  # fields of the classes that it is made from
    lacks_reason: ClassVar[str] = ""

    particle_spacing: Positive  # m
    volume_sampling: NotNegative = 2.0
    surface_sampling: NotNegative = 4.0
    density: Positive = DENSITY  # kg/m^3
    mass: Positive | None = None  # kg
    fill_holes: Flag = False  # of the mesh, also those wider than the particle spacing

    @model_validator(mode="before")
    @classmethod
    def _refuse_lacking(cls, fields: object) -> object:
        if not isinstance(fields, dict):
            return fields
        for name in cls.lacks:
            if name in fields:
                raise ValueError(f"{name}: {cls.lacks_reason}")
        if fields.get("mass") is not None and "density" in fields:
            raise ValueError("density: follows from the mass; give density or mass")
        return fields

    @model_validator(mode="after")
    def _something_is_sampled(self) -> RigidBody:
        if self.volume_sampling == 0 and self.surface_sampling == 0:
            raise ValueError("volume_sampling: must be over 0 where surface_sampling is 0, or there are no particles")
        if 0 < self.volume_sampling < 1 or self.volume_sampling > 8:
            raise ValueError("volume_sampling: must be 0, or from 1 (the particle spacing) to 8 (an eighth of it)")
        return self

    @classmethod
    def from_mesh(cls: type[Body], mesh: Meshes, **parameters: Any) -> BakedBody:
        """Return the body of a closed mesh: a TriangleMesh (`model.geometry.mesh.read_mesh`,
        `model.geometry.shapes.Shape.mesh`) or (position (vertices, 3) [m], triangles (n, 3)). The same on every call.

        Raises SceneError (a parameter) and InputError (the mesh), each with a remedy.
        """
        checked = parameters_of(cls, parameters)
        return checked.with_material(checked.bake(mesh))

    def bake(self, mesh: Meshes) -> BakedBody:
        """Return the body that `from_mesh` makes with these parameters, without its material."""
        spacing, body = (
            self.particle_spacing,
            solid(as_mesh(mesh, inside=True), self.particle_spacing, fill_holes=self.fill_holes),
        )
        samples = sample(body, spacing, self.volume_sampling, self.surface_sampling)
        total = self.density * samples.total if self.mass is None else self.mass
        with np.errstate(all="ignore"):
            mass = samples.volume * (total / samples.total)
        check_masses(self, mass)
        clusters, links, length, stiffness = self._bind(samples.position, mass, body.pieces)
        notes = (*body.notes, OVERLAPPING) if samples.overlapping else body.notes
        report = report_of(
            clusters,
            links,
            spacing,
            total,
            samples.surface,
            notes,
            volume=samples.total,
            pieces=body.pieces,
            samples=samples,
        )
        skin = make_skin(body.position, body.triangles, clusters.rest_centre)
        return BakedBody(samples.position, mass, clusters, links, length, stiffness, skin, spacing, report)

    def _bind(self, position: np.ndarray, mass: np.ndarray, pieces: int) -> Binding:
        """Return the links and clusters of particles: clusters, links (n, 2), their lengths (n,) [m] and their
        stiffness [N/m]."""
        return one_cluster(position, mass), np.zeros((0, 2), np.int32), np.zeros(0), 0.0

    def with_material(self, body: BakedBody) -> BakedBody:
        """Return the body with its clusters' material, which does not depend on the mesh; a rigid body has none."""
        return replace(body, report=replace(body.report, notes=(*body.report.notes, *self.idle(body.report))))

    def idle(self, report: Report) -> list[str]:
        """Return a note on each sampling parameter that was set and adds no particle, as the lattice inside leaves no
        gaps."""
        notes = []
        for name, added in (("volume_sampling", report.filled), ("surface_sampling", report.surface)):
            value = getattr(self, name)
            if value > (name == "volume_sampling") and value != type(self).model_fields[name].default and not added:
                notes.append(
                    f"{name} = {value:g} adds no particle: the lattice of particle_spacing fills the body already; try "
                    "another spacing"
                )
        return notes


class SoftBody(RigidBody):
    """A body of overlapping clusters.

    The centres of clusters are `cluster_spacing` apart (by default 2 particle spacings); a cluster contains the
    particles within `cluster_radius` (1.25 cluster spacings). `cluster_stiffness`: the square of the angular frequency
    at which a particle oscillates about its goal. Particles within `link_radius` of each other are linked, 0: none, by
    springs of `link_stiffness`.

    `linear`: how far a cluster follows a strain of its particles, from 0 (not at all) to 1 (any shear and stretch that
    preserves its volume). Above a strain of `plastic_threshold` its rest shape creeps towards the strain at the rate
    `plastic_creep` (0: never), up to a plastic strain of `plastic_limit` (by default 0.5). Motion in it that is not
    rigid decays at the rate `cluster_damping`.
    """

    cluster_spacing: Positive | None = None  # m
    cluster_radius: Positive | None = None  # m
    cluster_stiffness: NotNegative = 4000.0  # 1/s^2: ten swings a second
    link_radius: NotNegative = 0.0  # m
    link_stiffness: NotNegative = 0.0  # N/m
    linear: Fraction = 0.0
    plastic_threshold: NotNegative = 0.0
    plastic_creep: NotNegative = 0.0  # 1/s
    plastic_limit: Limit | None = None
    cluster_damping: NotNegative = 0.0  # 1/s

    @model_validator(mode="after")
    def _check_plasticity(self) -> SoftBody:
        if self.plastic_creep == 0 and (self.plastic_threshold > 0 or self.plastic_limit is not None):
            raise ValueError("plastic_creep: must be over 0 where plastic_threshold or plastic_limit is given")
        return self

    def material(self, clusters: int) -> Material | None:
        """Return the material of `clusters` clusters; None if they only rotate."""
        limit = LARGEST_STRAIN if self.plastic_limit is None else self.plastic_limit
        creeping = {"threshold": self.plastic_threshold, "creep": self.plastic_creep, "limit": limit}
        material = even(
            clusters, linear=self.linear, damping=self.cluster_damping, **(creeping if self.plastic_creep else {})
        )
        return material if material.parts else None

    def with_material(self, body: BakedBody) -> BakedBody:
        """Return the body with its clusters' material, and a note on clusters that it does not change."""
        clusters = replace(body.clusters, material=self.material(body.clusters.count))
        notes = (*body.report.notes, *self.idle(body.report))
        if clusters.parts & {"linear", "plastic"} and (flat := int(clusters.flat.sum())):
            notes = (
                *notes,
                f"{flat} of {clusters.count} clusters are flat: they only rotate and have no plastic strain",
            )
        return replace(body, clusters=clusters, report=replace(body.report, notes=notes))

    @model_validator(mode="after")
    def _check_cluster_sizes(self) -> SoftBody:
        if self.spacing_of_clusters < self.particle_spacing:
            raise ValueError(f"cluster_spacing: must be at least particle_spacing, {self.particle_spacing:g}")
        if "link_radius" not in self.lacks and (self.link_radius > 0) != (self.link_stiffness > 0):
            present, missing = (
                ("link_radius", "link_stiffness") if self.link_radius else ("link_stiffness", "link_radius")
            )
            raise ValueError(f"{missing}: must be over 0 where {present} is, or there are no links")
        return self

    @property
    def spacing_of_clusters(self) -> float:
        """Distance between clusters [m]."""
        return SPACINGS * self.particle_spacing if self.cluster_spacing is None else self.cluster_spacing

    @property
    def radius_of_clusters(self) -> float:
        """Radius of clusters [m]."""
        return OVERLAP * self.spacing_of_clusters if self.cluster_radius is None else self.cluster_radius

    def _bind(self, position: np.ndarray, mass: np.ndarray, pieces: int) -> Binding:
        spacing, radius = self.spacing_of_clusters, self.radius_of_clusters
        links, length = self._links(position)
        clusters = gather(position, mass, spacing, radius, self.cluster_stiffness)
        check(clusters, links, spacing, radius, pieces)
        return clusters, links, length, self.link_stiffness

    def _links(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (n, 2) int32 and their lengths [m]. Raises SceneError where `link_radius` reaches no particle, or too
        many."""
        try:
            one, other, length = close_pairs(position, self.link_radius)
        except TooMany as error:
            raise SceneError("link_radius", self.link_radius, str(error)) from None
        if self.link_radius and not len(one):
            raise SceneError(
                "link_radius", self.link_radius,
                f"links no particles, because none are that close; try {1.5 * self.particle_spacing:.3g}, or leave it out",
            )  # fmt: skip
        return np.stack([one, other], axis=1).astype(np.int32), length


def check_masses(parameters: RigidBody, mass: np.ndarray) -> None:
    """Raise SceneError for particles of a body without a mass, or with one beyond all numbers [kg]."""
    smallest = 1 / np.finfo(np.float64).max  # of lighter ones the inverse is no number
    if not (np.isfinite(mass).all() and (mass > smallest).all()):
        field = "density" if parameters.mass is None else "mass"
        raise SceneError(
            field, getattr(parameters, field),
            f"gives a particle {mass.min():.3g} kg, and none can move without a mass; change it, or the body's size",
        )  # fmt: skip


def parameters_of(kind: type[Body], fields: dict[str, Any]) -> Body:
    """Return the parameters, checked. Raises SceneError."""
    try:
        return kind(**fields)
    except ValidationError as error:
        refusal = scene_error(kind.__name__, error, kind)
        raise SceneError(refusal.field.removeprefix(f"{kind.__name__}."), refusal.value, refusal.allowed) from None
