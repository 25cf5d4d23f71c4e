"""The parts of a cloth in space, each a validated table: the sheet, its springs, wind, and its colliders."""

from __future__ import annotations

from math import hypot
from typing import Annotated, Literal

from pydantic import Field, model_validator

from softlab.model.base.table import ZERO, NotNegative, Part, Positive, Seed, Vector
from softlab.model.tables.motion import Motion
from softlab.model.tables.parts import Elastic, Grid, friction_is_ordered


class Cloth(Grid):
    """N rows x M columns of point masses in three dimensions, pinned like a grid.

    At rest `hanging` in a plane z = const, row 0 on top, or `flat` in a plane y = const, row 0 behind (least z). Two
    triangles a cell, split from its first mass (row, column) to the one opposite.
    """

    placement: Literal["hanging", "flat"] = "hanging"
    origin: Vector = ZERO  # m, of the mass in row 0, column 0


class Fold(Part):
    """Start: the sheet folded zig-zag, each layer `rows` rows of masses long and `apart` spacings from the next.

    Layers lie above one another where the cloth is flat, behind one another (+z) where it hangs. Between two layers the
    sheet turns twice by a right angle, so that no edge is stretched; with 0 they coincide, and the last row of one is
    the first of the next.
    """

    rows: Annotated[int, Field(ge=2, strict=True)]
    apart: Annotated[int, Field(ge=0, strict=True)] = 1


class ClothSprings(Elastic):
    """Springs of one kind between all masses at that distance; the rest length is the distance in the sheet at rest.

    Force along the spring: stiffness * (length - rest length) + damping * the speed at which it lengthens.
    """

    stiffness: Positive = 100.0  # N/m
    damping: NotNegative = 0.0  # N s/m, along the spring


class Structural(ClothSprings):
    """Springs to the neighbours in the row and in the column, against stretching."""


class Shear(ClothSprings):
    """Springs along both diagonals of every cell, against shear."""


class Bending(ClothSprings):
    """Springs to the masses two apart in row and column, against folding.

    On a mesh, by `model`: a spring across each edge, between the two vertices opposite (`distance`, stiffness in N/m);
    or a hinge at each edge with the material's bending stiffness, in N m, as one quadratic form (`isometric`, for
    meshes that hardly stretch and are flat at rest) or by the angle between both triangles (`dihedral`). Both are
    energies of hinges, and store up to three times the energy of a plate of that stiffness where only a third of the
    hinges bend.
    """

    stiffness: Positive = 10.0
    model: Literal["distance", "isometric", "dihedral"] = "distance"

    def _idle_fields(self) -> set[str]:
        return super()._idle_fields() | ({"model"} if self.model == "distance" else set())


class Volume(Elastic):
    """A filling of a closed mesh: tetrahedra between its vertices, each of which conserves its volume.

    Each stores the energy stiffness / 2 * (V - V0)^2 / V0 of its volume V, as a nearly incompressible material of that
    bulk modulus; it does not resist shear. There are no particles inside: a tetrahedron extends from side to side.
    """

    stiffness: Positive = 1e4  # Pa, the bulk modulus
    compliance: NotNegative | None = None  # 1/Pa; 0: incompressible


class Wind(Part):
    """Moving air: a force on every triangle from its velocity relative to the air.

    With N the triangle's normal, u the relative velocity and A the area: along u, density / 2 * drag * A |u.N| u;
    perpendicular to it, density / 2 * lift * A (u.N) (|u| N - (u.N) u / |u|): a flat plate's drag and lift. A third for
    each corner. The air's velocity is velocity * (1 + gust * g(t)), g a smooth random function in (-1, 1) with a new
    value every gust_time.
    """

    velocity: Vector = (0.0, 0.0, 5.0)  # m/s
    density: Positive = 1.2  # kg/m^3
    drag: NotNegative = 1.0
    lift: NotNegative = 0.5
    gust: Annotated[float, Field(ge=0, le=1, strict=True)] = 0.0
    gust_time: Positive = 0.5  # s
    seed: Seed = 0


class Collider(Part):
    """An obstacle that masses cannot enter. A mass nearer than `thickness` is moved to that distance; its velocity into
    the collider is removed, and Coulomb friction acts against the rest, relative to the collider's own velocity. The
    fraction `restitution` of the removed velocity is returned outward where it is more than gravity adds within two
    steps. The default `thickness` for bodies is the depth of their outermost particles below their skin, so that they
    rest on it (of several bodies the depth that suits most; at least 1 % of the spacing)."""

    velocity: Vector = ZERO  # m/s, constant
    thickness: NotNegative = 0.01  # m
    static_friction: NotNegative = 0.0
    dynamic_friction: NotNegative = 0.0  # at most static_friction
    restitution: Annotated[float, Field(ge=0, le=1, strict=True)] = 0.0

    _friction_is_ordered = model_validator(mode="after")(friction_is_ordered)

    def _idle_fields(self) -> set[str]:
        return set() if self.restitution else {"restitution"}


class Plane(Collider):
    """The half space behind a plane."""

    point: Vector = ZERO  # m
    normal: Vector = (0.0, 1.0, 0.0)

    @model_validator(mode="after")
    def _normal_has_a_length(self) -> Plane:
        if hypot(*self.normal) == 0:
            raise ValueError("normal: must not be zero")
        return self


class Sphere(Collider):
    """A ball. A mass that would fly through it within a step is stopped where it enters."""

    center: Vector = ZERO  # m
    radius: Positive = 0.5  # m


class Capsule(Collider):
    """All points within `radius` of the segment from `start` to `end`."""

    start: Vector = ZERO  # m
    end: Vector = (1.0, 0.0, 0.0)  # m
    radius: Positive = 0.1  # m


class Box(Collider):
    """A block with its edges along the axes."""

    center: Vector = ZERO  # m
    half_size: tuple[Positive, Positive, Positive] = (0.5, 0.5, 0.5)  # m


CLOTH_KINDS: dict[str, type[Part]] = {
    "cloth": Cloth,
    "structural": Structural,
    "shear": Shear,
    "bending": Bending,
    "volume": Volume,
    "wind": Wind,
    "plane": Plane,
    "sphere": Sphere,
    "capsule": Capsule,
    "box": Box,
    "motion": Motion,
    "fold": Fold,
}
SURFACE_KINDS = ("mesh_collider", "distance_field")  # colliders made from a mesh
COLLIDER_KINDS = ("plane", "sphere", "capsule", "box", *SURFACE_KINDS)
SPRING_KINDS = ("structural", "shear", "bending")
CONSTRAINT_KINDS = (*SPRING_KINDS, "volume")  # what a mesh may have, in the order of projection
