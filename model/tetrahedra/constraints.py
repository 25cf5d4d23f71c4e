"""Constraints of a scene's tetrahedra, by material and colour, and of a cloth beside them; the plan of a position-based
step."""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from softlab.model.contact.attachments import attachment_parts, attachment_projections, attachment_sets
from softlab.model.core.plan import Node, Plan, Stage
from softlab.model.formulas.constraints import attachment, tetrahedron, voxel_volume
from softlab.model.formulas.elastic import sleep
from softlab.model.geometry.colouring import colour
from softlab.model.particles.constraints import ConstraintSet, Projection
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.position_based import mesh_constraints as of_cloths
from softlab.model.position_based.mesh_plan import (
    BODY_DAMPING,
    constrained_plan,
    model_parts,
    with_friction_in_place,
    with_touching,
)
from softlab.model.position_based.plan import xpbd_parts
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.material import constraint_values, material_of, voxel_values
from softlab.model.tetrahedra.voxel_order import voxel_order

CONSTANTS = ("elastic_compliance", "elastic_damping", "elastic_stiffening")  # of the record: m / h^2, 1 / h, 1
SLEEPING, SLEEP = "sleeping-vertices", "keep places"  # a part of a plan, a stage
WHOLE = "tetrahedra-volumes-of-voxels"
DAMPED, BLOCKS, ITERATED, CLOTH = "tetrahedra-damping", "tetrahedra-blocks", "tetrahedra-iterated", "cloth"
KINDS = {1: "tetrahedra", 5: "voxels", 6: "Kuhn voxels"}  # of sets, by the number of tetrahedra of a run
SHAPES, VOLUMES = "voxels' shapes", "voxels' volumes"  # of sets of voxels that conserve their volume as a whole
Sets = tuple[tuple[np.ndarray, ...], tuple[ConstraintSet, ...]]
_known: WeakKeyDictionary[TetrahedraSet, Sets] = WeakKeyDictionary()  # cached, since colouring is slow


def tetrahedra_parts(scene: Scene, live: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return the parts that need code: a sheet's (model/position_based/plan.py), the materials, dampers, blocks, kept
    multipliers, a cloth's models.

    Every mass has its own weight (`load`).
    """
    body_set = scene.tetrahedra_set
    damped = {DAMPED} if body_set.alike.matter.damping.any() else set()
    blocks = {BLOCKS} if scene.method.rows == "blocks" else set()
    iterated = {ITERATED} if scene.method.iterations > 1 else set()
    sleeping = {SLEEPING} if scene.method.sleeping_speed > 0 else set()
    movable = {"motion"} if "targets" in live and len(body_set.pinned_vertices) else set()
    parts = xpbd_parts(scene, live) | {"load"} | {part.material for part in body_set.parts}
    slowed = {BODY_DAMPING} if any(part.mass_damping > 0 for part in body_set.alike.parts) else set()
    cloth = model_parts(scene) | ({CLOTH} if scene.mesh else frozenset())
    whole = {WHOLE} if any(part.volume == "voxels" for part in body_set.parts) else set()
    features = damped | blocks | iterated | movable | slowed | sleeping | cloth | whole
    return parts | features | attachment_parts(body_set)


def materials(parts: frozenset[str]) -> tuple[str, ...]:
    """Return the materials of a scene, in the order of projection."""
    return tuple(name for name in tetrahedron.MATERIALS if name in parts)


def part_of_run(material: str, run: int, whole: bool = False) -> str:
    """Return the part of a scene whose tetrahedra of a material are in runs of `run`; `whole`: voxels conserve their
    volume."""
    return f"{material}-{'wholes' if whole else 'runs'}-{run}"


def projections_of(parts: frozenset[str]) -> tuple[Projection, ...]:
    """Return the projections of a scene with such parts, one per material and run length (1 by default).

    Then those of a cloth, and of attachments.
    """
    projections: list[Projection] = []
    for name in materials(parts):
        kinds = [(run, whole) for run in KINDS for whole in (False, True) if part_of_run(name, run, whole) in parts]
        for run, whole in kinds or [(1, False)]:
            projections.append(_projection(name, run, whole, parts))
            if whole:
                projections.append(_of_volumes(name, parts))
    return (
        tuple(projections)
        + of_cloths.projections_of(parts)
        + tuple(attachment_projections(parts, ITERATED in parts, CONSTANTS))
    )


def _projection(material: str, run: int, whole: bool, parts: frozenset[str]) -> Projection:
    """Return the projection of tetrahedra; only of their shapes where voxels conserve the volume as a `whole`."""
    damped, blocks, soft = DAMPED in parts, BLOCKS in parts, ITERATED in parts
    nine = blocks or material == tetrahedron.MATERIALS[tetrahedron.HOOKEAN]
    flags = {
        "material": tetrahedron.MATERIALS.index(material), "damped": damped, "blocks": blocks, "soft": soft,
        "alone": not whole,
    }  # fmt: skip
    return Projection(
        f"{'shapes' if whole else 'tetrahedra'}_{material.replace('-', '_')}", tetrahedron, 4, tetrahedron.COUNT,
        tetrahedron.BLOCKS if nine else tetrahedron.ROWS, damped=damped, soft=soft, constants=CONSTANTS,
        flags=tuple(flags.items()), run=run,
    )  # fmt: skip


def _of_volumes(material: str, parts: frozenset[str]) -> Projection:
    """Return the projection of the volumes of voxels for this material."""
    damped, soft = DAMPED in parts, ITERATED in parts
    return Projection(
        f"volumes_{material.replace('-', '_')}", voxel_volume, voxel_volume.CORNERS, voxel_volume.COUNT,
        damped=damped, soft=soft, constants=CONSTANTS, flags=(("damped", damped), ("soft", soft)),
    )  # fmt: skip


def constraint_sets(scene: Scene) -> tuple[ConstraintSet, ...]:
    """Return the tetrahedra of each material, those of voxels separately, then a cloth's, then attachments, sorted by
    colours.

    Cached with the bodies, and with the cloth's mesh.
    """
    body_set = scene.tetrahedra_set
    cloth: list[ConstraintSet] = []
    if body_set.sheet:
        start = np.int32(body_set.first_particle[-1])
        cloth = [replace(one, corners=one.corners + start) for one in of_cloths.constraint_sets(scene)]
    return (*_known_sets(body_set)[1], *cloth, *attachment_sets(body_set))


def tetrahedra_of_sets(body_set: TetrahedraSet) -> tuple[np.ndarray, ...]:
    """Return the tetrahedron of each constraint, (n,) int64, for each of the constraint sets of tetrahedra.

    For voxels' volumes it is the first one of each.
    """
    return _known_sets(body_set)[0]


def _known_sets(body_set: TetrahedraSet) -> Sets:
    """Return (the tetrahedra of each set, the sets); for a part those of the whole set, in its colours and order."""
    if body_set not in _known and body_set.whole is not None:
        particles, tetrahedra = body_set.of_whole
        pairs = []
        for chosen, one in zip(*_known_sets(body_set.whole), strict=True):
            inside = np.isin(chosen, tetrahedra)
            if inside.any():
                pairs.append((one.some(inside, particles), np.searchsorted(tetrahedra, chosen[inside])))
        _known[body_set] = tuple(chosen for _, chosen in pairs), tuple(one for one, _ in pairs)
    elif body_set not in _known:
        whole = np.array([part.volume == "voxels" for part in body_set.parts])[body_set.body]
        kinds = np.stack([material_of(body_set), body_set.run, whole])
        each = (np.flatnonzero((kinds == kind[:, None]).all(axis=0)) for kind in np.unique(kinds, axis=1).T)
        pairs = [both for chosen in each for both in _coloured(body_set, chosen, bool(whole[chosen[0]]))]
        _known[body_set] = tuple(chosen for _, chosen in pairs), tuple(one for one, _ in pairs)
    return _known[body_set]


def _coloured(body_set: TetrahedraSet, chosen: np.ndarray, whole: bool) -> list[tuple[ConstraintSet, np.ndarray]]:
    """Return the set of the chosen tetrahedra, all of one material and run, and their indices in its order.

    Where voxels conserve their volume as a `whole`, their set follows. Large tetrahedra are treated as any other: only
    places count.
    """
    run = int(body_set.run[chosen[0]])
    if run > 1:
        order, starts, corners = voxel_order(body_set, chosen, run)
    else:
        colours = colour(body_set.tetrahedra[chosen], body_set.particle_count)
        order, starts, corners = colours.order, colours.starts, body_set.tetrahedra[chosen[colours.order]]
    chosen = chosen[order]
    name = body_set.parts[body_set.body[chosen[0]]].material
    values = constraint_values(body_set, chosen, corners)
    one = ConstraintSet(SHAPES if whole else KINDS[run], name, corners, values, starts, run)
    if not whole:
        return [(one, chosen)]
    voxels = corners.reshape(-1, run, 4)
    eight = np.ascontiguousarray(np.concatenate([voxels[:, :-1, 0], voxels[:, -1]], axis=1))
    volumes = ConstraintSet(VOLUMES, name, eight, voxel_values(body_set, chosen, run), starts // run)
    return [(one, chosen), (volumes, chosen[::run])]


def through_note(scene: Scene) -> str:
    """Return the addition to a note on a method where a scene's bodies do not collide."""
    if len(scene.holdable) < 2 or scene.contact is not None:
        return ""
    return "; its bodies pass through each other, since it has no [contact]"


def operations_of(projection: Projection) -> int:
    """Return the operations of one constraint."""
    flags = dict(projection.flags)
    if projection.formulas is attachment:
        return attachment.OPERATIONS[flags["corners"]]
    if projection.formulas is tetrahedron:
        return tetrahedron.operations(item=4, **flags)
    if projection.formulas is voxel_volume:
        return voxel_volume.OPERATIONS + voxel_volume.OPERATIONS_DAMPER * projection.damped
    return of_cloths.operations_of(projection)


def tetrahedra_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """Return the plan: substeps and iterations as in model/position_based/plan.py; an iteration has the tetrahedra of each
    material, colour by colour."""
    sets = constraint_sets(scene)
    kinds = {SHAPES, *KINDS.values()}
    runs = {part_of_run(rows.model, rows.run, rows.kind == SHAPES) for rows in sets if rows.kind in kinds}
    parts = with_touching(scene, with_friction_in_place(tetrahedra_parts(scene, live) | runs))
    operations = [operations_of(one) for one in projections_of(parts)]
    plan = constrained_plan(scene, parts, list(zip(sets, operations, strict=True)))
    return with_sleep(plan, scene.method.substeps) if SLEEPING in parts else plan


def with_sleep(plan: Plan, substeps: int) -> Plan:
    """Return the plan with a stage at the end of each substep that keeps slow vertices at their positions."""
    (substep,) = plan.root.children
    assert isinstance(substep, Node)
    ends = Stage(SLEEP, 3, 2, sleep.OPERATIONS)
    whole = Node("step", (Node("substep", (*substep.children, ends), substeps),))
    return Plan(whole, plan.fused_scalars, plan.parts, dimensions=3)
