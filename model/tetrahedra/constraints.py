"""The constraints of a scene's tetrahedra, by material and colour, and the plan of a position-based step with them."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from model.core.constraints import ConstraintSet, Projection
from model.core.plan import Plan
from model.formulas.constraints import attachment, tetrahedron
from model.scene.scene import Scene
from model.tetrahedra.attachments import attachment_parts, attachment_projections, attachment_sets
from model.tetrahedra.body_set import TetrahedraSet
from model.tetrahedra.material import constraint_values, material_of
from model.xpbd.colouring import colour
from model.xpbd.mesh_plan import BODY_DAMPING, constrained_plan
from model.xpbd.plan import xpbd_parts

CONSTANTS = ("elastic_compliance", "elastic_damping", "elastic_stiffening")  # of the record: m / h^2, 1 / h, 1
DAMPED, BLOCKS, ITERATED = "tetrahedra-damping", "tetrahedra-blocks", "tetrahedra-iterated"
_known: WeakKeyDictionary[TetrahedraSet, tuple[ConstraintSet, ...]] = WeakKeyDictionary()  # colouring is slow


def tetrahedra_parts(scene: Scene, live: frozenset[str] = frozenset()) -> frozenset[str]:
    """The parts that need code: a sheet's (model/xpbd/plan.py), the materials, whether one has a damper, whether they
    are taken as blocks and whether multipliers are kept. Every mass has a weight of its own (`load`)."""
    bodies = scene.tetrahedra.values()
    damped = {DAMPED} if scene.tetrahedra_set.matter.damping.any() else set()
    blocks = {BLOCKS} if scene.method.rows == "blocks" else set()
    iterated = {ITERATED} if scene.method.iterations > 1 else set()
    told = {"motion"} if "targets" in live and len(scene.tetrahedra_set.pinned_vertices) else set()
    parts = xpbd_parts(scene, live) | {"load"} | {part.material for part in bodies}
    slowed = {BODY_DAMPING} if any(part.mass_damping > 0 for part in bodies) else set()
    return parts | damped | blocks | iterated | told | slowed | attachment_parts(scene.tetrahedra_set)


def materials(parts: frozenset[str]) -> tuple[str, ...]:
    """Those that are there, in the order in which they are projected."""
    return tuple(name for name in tetrahedron.MATERIALS if name in parts)


def projections_of(parts: frozenset[str]) -> tuple[Projection, ...]:
    """Of a scene of such parts, one a material; then those of attachments."""
    damped, blocks = DAMPED in parts, BLOCKS in parts
    multipliers = tetrahedron.BLOCKS if blocks else tetrahedron.ROWS
    own = tuple(
        Projection(
            f"tetrahedra_{name.replace('-', '_')}", tetrahedron.make, 4, tetrahedron.COUNT, multipliers, damped=damped,
            soft=ITERATED in parts, constants=CONSTANTS,
            flags=(("material", tetrahedron.MATERIALS.index(name)), ("damped", damped), ("blocks", blocks)),
        )
        for name in materials(parts)
    )  # fmt: skip
    return own + tuple(attachment_projections(parts, ITERATED in parts, CONSTANTS))


def constraint_sets(scene: Scene) -> tuple[ConstraintSet, ...]:
    """The tetrahedra of each material, then attachments, sorted by colours. Kept with the bodies."""
    found = scene.tetrahedra_set
    if found not in _known:
        made = material_of(found)
        own = tuple(_coloured(found, np.flatnonzero(made == kind)) for kind in np.unique(made))
        _known[found] = own + attachment_sets(found)
    return _known[found]


def _coloured(found: TetrahedraSet, chosen: np.ndarray) -> ConstraintSet:
    """The chosen tetrahedra, all of one material. Those of a large volume are as good as any other: only places count."""
    colours = colour(found.tetrahedra[chosen], found.particle_count)
    chosen = chosen[colours.order]
    name = found.parts[found.body[chosen[0]]].material
    corners = np.ascontiguousarray(found.tetrahedra[chosen])
    return ConstraintSet("tetrahedra", name, corners, constraint_values(found, chosen), colours.starts)


def operations_of(projection: Projection) -> int:
    """Of one constraint."""
    flags = dict(projection.flags)
    if projection.make is attachment.make:
        return attachment.OPERATIONS[flags["corners"]]
    return tetrahedron.operations(flags["material"], 4)


def tetrahedra_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """Substeps and iterations as in model/xpbd/plan.py; of an iteration the tetrahedra of each material, colour by colour."""
    parts = tetrahedra_parts(scene, live)
    operations = [operations_of(one) for one in projections_of(parts)]
    return constrained_plan(scene, parts, list(zip(constraint_sets(scene), operations, strict=True)))
