"""The kinds of tables of a scene file, and which of them may occur more than once."""

from __future__ import annotations

from softlab.model.base.table import Part
from softlab.model.tables.attachment import Attachment
from softlab.model.tables.bodies import BODY_KINDS
from softlab.model.tables.cloth import CLOTH_KINDS, COLLIDER_KINDS
from softlab.model.tables.colliders.distance_field import DistanceField
from softlab.model.tables.colliders.mesh_collider import MeshCollider
from softlab.model.tables.flow import FLOW_KINDS
from softlab.model.tables.fluid import FLUID_KINDS
from softlab.model.tables.mesh import MESH_KINDS
from softlab.model.tables.method import Method
from softlab.model.tables.motion import RELEASE, Release
from softlab.model.tables.particle_contact import Contact
from softlab.model.tables.parts import GRID_KINDS
from softlab.model.tables.regions import Region
from softlab.model.tables.tetrahedra import TETRAHEDRAL_KINDS, Material
from softlab.model.tables.xpbd import XPBD_KINDS

KINDS: dict[str, type[Part]] = (
    GRID_KINDS
    | {"method": Method}
    | CLOTH_KINDS
    | {"mesh_collider": MeshCollider, "distance_field": DistanceField}
    | MESH_KINDS
    | XPBD_KINDS
    | BODY_KINDS
    | TETRAHEDRAL_KINDS
    | FLUID_KINDS
    | FLOW_KINDS
    | {"contact": Contact, "region": Region, "attachment": Attachment, "material": Material, RELEASE: Release}
)
REMOVED = {  # kinds of former versions: what to use instead
    "manufactured": "scenes have no manufactured force any more; delete this table (orders: softlab accuracy --findings)",
    "wetting": "cloths no longer absorb fluid; delete this table and give the cloth its wet mass or density",
}
SHEETS = ("grid", "cloth", "mesh")  # a scene has at most one of them
SEVERAL = (
    *SHEETS,
    *BODY_KINDS,
    *TETRAHEDRAL_KINDS,
    "fluid",
    *FLOW_KINDS,
    *COLLIDER_KINDS,
    "load",
    "motion",
    "region",
    "attachment",
    "material",
    RELEASE,
)  # may occur more than once, or are refused elsewhere
