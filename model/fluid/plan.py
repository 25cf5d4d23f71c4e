"""A substep of a fluid: its passes (POSITIONS), and the order of every sum in them, which both backends follow.

The scheme `divergence-free` is in model/fluid/divergence_plan.py. Arrays are planes (x, y, z; in 2 dimensions z is 0
throughout, and the rest is the same). `number` of a particle is its index in the scene's set. The state between
substeps is only position and velocity. Every computation is a formula of model/formulas/fluid (density.py, motion.py,
cells.py), except comparisons and integer sums.

0. `emit`, with emitters: particles leave nozzles (model/formulas/fluid/flow.py). For each emitter, in the order of the
   file: layer k begins in the substep from t to t + h where passed(t) <= k < passed(t + h), by `begun`; its particles,
   in the order of the nozzle's points, are `emitted` at the layers passed by t + h. Each is the inactive particle of
   its fluid with the lowest number; where there is none, it is counted as missing. Inactive particles take part in
   nothing.
1. `predict`. a = (0, buoyant(gravity, buoyancy), 0), then own forces (model/core/own_forces.py, by the particle's
   number), gravity only where the plan has it. u = accelerated(v, dt, a) axis by axis; speed_of(u), `slowed` to
   F_SPEED; p = drifted(x, u, dt). On an axis that repeats: shift = wrapped_offset(p, low, high, side), added to p and to
   x. Then colliders, from x to p with u; their response velocity is discarded. Particles that exceed F_SPEED are
   counted.
2. `sort into cells`. low = the smallest p of all particles along each axis, high = the largest, of the finite ones (on
   an axis that repeats both are from the record). A table (model/formulas/fluid/cells.py): inverse = inverse_cell,
   count = cells_along(low, high, inverse); on an axis that repeats inverse = inverse_side and count = cells. While not
   fits(nx, ny, nz, most_cells): among the axes that do not repeat, the one with the largest count (the first of equal
   ones) gets halved(inverse) and a new count; if that count is 1, the loop ends. Cell along an axis: cell_of(p, low,
   inverse, count); cell = (z * ny + y) * nx + x. Particles are sorted by ascending (cell, number): their order is a
   function of positions alone, whatever it was before. A particle predicted within a sink is not sorted, and is
   inactive from then on. x, p, u, number and fluid are sorted together.
3. `find neighbours`. For each particle, those within the support of p, without itself: cells z - 1, z, z + 1, in each y
   - 1, y, y + 1, in each x - 1, x, x + 1 (a run: consecutive places), in a cell ascending places. Beyond the table
   there are none, but on an axis that repeats they wrap around (x: cell -1 is the last one, searched first). At most
   MAX_NEIGHBOURS are listed; those beyond are counted and reported. d = x_i - x_j is `wrapped` on axes that repeat,
   everywhere.
4. In the same stage, factors: g = 0, own = 0; for each neighbour: dy = apart(...), squared again, s = slope, g =
   gradient_added, own = squares_added (weight of j's fluid). Walls (below) at p. `factor` with F_WEIGHT of i; multiplier =
   0.
5. iteration, `iterations` times:
   `density`. total = 0; for each neighbour total = density_added(total, closeness(squared)); (wall density, its
   gradient) at p; c = constraint(...); delta = change(multiplier, factor, c), which is added to the multiplier; scheme
   averaged: delta = change_alone(factor, c).
   `correct`, from all positions at once into new ones. a = 0; for each neighbour: as in 4 dy, squared and s; both =
   delta_i + delta_j; with the tensile correction both = both - crowded(near, ...); a = correction_added(a, both, s, d).
   Then a = wall_added(a, delta_i, w) axis by axis. p = moved(p, F_WEIGHT, a). Then colliders, from x to p, capsules and
   boxes by model/formulas/fluid/sweep.py, so that no path leads through them; their response velocity (for the velocity
   0) is discarded.
6. `update velocity`. v = velocity_of(p, x, inverse_dt); with a maximum acceleration limited_change(v, u, speed_of(v - u),
   F_CHANGE). Colliders, from x to drifted(x, u, dt) with u, give q and u': where q differs from that place, v =
   after_impact(u', p, q, inverse_dt), limited_change from u'. Where the multiplier is negative, for each collider at q, as
   they are joined in Walls: push = wall_push(multiplier, F_WEIGHT, slope, rate(share, total), inverse_dt), v =
   without(v, rebound(v, u', w, n, push), n), w the velocity of its surface (model/formulas/fluid/impact.py). Then
   colliders, from x to p with v.
7. `normals and vorticity`, where needed: n = 0, w = 0; for each neighbour: dy, squared, s at the new p; n =
   gradient_added; w_x = curl_added(w_x, s, dy, dz, vy, vz, ...), w_y of (z, x), w_z of (x, y).
8. In the next stage, where needed: sums m = 0, f = 0, r = 0; for each neighbour, those that the scene has: m =
   smooth_added, f = pull_added, f = tension_added, r = rise_added (lengths speed_of(w)). v = smoothed(v, m, F_WEIGHT,
   f), then confined of the axes (y, z), (z, x), (x, y). From all velocities at once into new ones.
9. `limit velocities`: with drag braked(..., c), c of the last iteration's `density`; speed_of(v), `slowed` to F_SPEED.
   The new state is p and v.

Walls, of all colliders in their order: t = wall_near(beyond(distance, thickness)), share = wall_density(t), slope =
wall_slope(t); gradient = joined_gradient(gradient, total, slope, share, n) axis by axis, then total =
joined_density(total, share), from 0. Distances: `plane`, `sphere`, `capsule`, `box` of model/formulas/colliders.py, of
a collider that is `moved` (model/formulas/cloth.py) to the substep's end; for those made from a mesh those of
model/formulas/fluid/surfaces.py, within support + thickness.

A particle's pressure is that of its pairs: the mean over neighbours, weighted by s r^2, of -(multiplier_i +
multiplier_j) / 2 * density / dt^2 of the last substep (`pressures` of model/fluid/measure.py).

Solids (part `solids`, for a fluid that is opened with Samples, model/fluid/samples.py). Samples are particles after all
others by number, of one more fluid, whose row is the last. `sample solids`, between 1 and 2: for each, p =
middle(corners at their predicted positions, shares), x the same for their positions at the substep's start; the
smallest and largest p of 2 include samples. Two samples are not neighbours (3). 4: C, g and `own` count neighbours by
their volumes (model/formulas/fluid/solids.py): s' = counted_slope(volume, s), g = gradient_added(g, s', d), own =
squares_added(own, carried(lightness, volume), s, r^2); for samples the factor, the multiplier and its change are 0. An
iteration: `follow solids` puts samples between their corners; `density` counts by `counted`; `correct`: both =
both(delta_i, delta_j, volume_i, volume_j), the tensile correction only for pairs of particles; a = correction_added.
Then, with viscosity, over the list again, for pairs of a particle and a sample, share = rub(near, F_VISCOSITY_i, _j,
lightness_i, _j, grip_i, _j), a = rub_added(a, share, p_i - x_i, p_j - x_j). The a of a sample is the push on it; only
fluid particles touch walls and colliders. `push solids`: for each of the solids' particles x = 0, x = carried_on(x,
share, a of a sample) in the samples' order, p = moved(p, lightness, x). 7 and 8 omit samples.

Where all fluids weigh the same (no part `fluids`), F_ rows are the first one's, whichever fluid a particle belongs to.
"""

from __future__ import annotations

from math import pi

from softlab.model.base.variant import features_of
from softlab.model.core.own_forces import force_features, particle_forces
from softlab.model.core.plan import Node, Plan
from softlab.model.fluid.divergence_plan import DIVERGENCE_FREE, SEARCH
from softlab.model.fluid.passes import (
    CORRECT,
    DENSITY,
    EMIT,
    FOLLOW,
    LIMIT,
    PREDICT,
    PUSH,
    SAMPLE,
    SHAPE,
    SHAPES,
    SMOOTHING,
    SORT,
    UPDATE,
    Iterations,
    Pass,
    Scalars,
    Substep,
    around,
    chosen,
    stages_of,
)
from softlab.model.formulas import colliders
from softlab.model.formulas.fluid import density, motion
from softlab.model.formulas.fluid.flow import OPERATIONS_SINK
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import COLLIDER_KINDS

WALLS = COLLIDER_KINDS  # all add to a fluid's density
LOOKED_AT = {2: 9, 3: 27}  # cells that a search visits
OPERATIONS_SAMPLE = 5  # per axis of a sample: three products and two sums
FLOWS = frozenset({"emitter", "sink"})
OF_FLUIDS = {  # part of the plan -> field of a fluid that needs it
    "viscosity": "viscosity",
    "cohesion": "cohesion",
    "surface-tension": "surface_tension",
    "vorticity": "vorticity_confinement",
}
SOLIDS = frozenset({"solids"})
POSITIONS = (  # of the schemes that correct positions
    Pass(EMIT, needs=frozenset({"emitter"})),
    Pass(PREDICT, Scalars(2), Scalars(2), {"particle": motion.OPERATIONS_VELOCITY, "force": 1}),
    Pass(SAMPLE, Scalars(2), Scalars(2), {"particle": OPERATIONS_SAMPLE}, needs=SOLIDS),
    Pass(SORT, Scalars(4), Scalars(4), {"axis": 4, "sink": OPERATIONS_SINK}),
    SEARCH,
    Iterations(
        (
            Pass(FOLLOW, Scalars(1), Scalars(1), {"particle": OPERATIONS_SAMPLE}, needs=SOLIDS),
            Pass(DENSITY, around(1), Scalars(1), {"neighbour": density.OPERATIONS_DENSITY}),
            Pass(CORRECT, around(1), Scalars(1), {"neighbour": density.OPERATIONS_CORRECT, "collider": 1}),
            Pass(PUSH, Scalars(2), Scalars(1), {"particle": 4}, needs=SOLIDS),
        )
    ),
    Pass(UPDATE, Scalars(2), Scalars(1), {"particle": 20, "collider": 1}),
    Pass(SHAPE, around(2, particle=2), Scalars(2), {"neighbour": motion.OPERATIONS_SHAPE}, needs=SHAPES),
    Pass(LIMIT, Scalars(1), Scalars(2), {"particle": motion.OPERATIONS_VELOCITY}, without=SMOOTHING),
    Pass(
        LIMIT, around(2, particle=2), Scalars(2),
        {"particle": motion.OPERATIONS_VELOCITY, "neighbour": motion.OPERATIONS_SMOOTH}, needs=SMOOTHING,
    ),
)  # fmt: skip


def substep_of(parts: frozenset[str]) -> Substep:
    """Return the passes of a substep, in order."""
    return chosen(DIVERGENCE_FREE if "divergence-free" in parts else POSITIONS, parts)


def periodic_axes(repeats: frozenset[str]) -> dict[str, bool]:
    """Return the features of kernels in a domain that is periodic along the axes `repeats`."""
    return {f"periodic_{axis}": axis in repeats for axis in "xyz"}


def fluid_features(parts: frozenset[str], repeats: frozenset[str] = frozenset()) -> dict[str, int]:
    """Return the features of a fluid's kernels (model/base/variant.py). `repeats`: axes that are periodic."""
    more = {
        "axes": 2 if "flat" in parts else 3,
        "colliders": bool(parts & set(COLLIDER_KINDS)),
        "flow": bool(parts & FLOWS),
        "limited_change": "held-back" in parts,
        "shapes": bool(parts & SHAPES),
        "smoothing": bool(parts & SMOOTHING),
    }
    return {**features_of(parts), **more, **periodic_axes(repeats)}


def fluid_parts(scene: Scene, live: frozenset[str] = frozenset(), solids: bool = False) -> frozenset[str]:
    """Return the parts that need code.

    `flat` (2 dimensions), `fluids` (several), `solids` (and so several), `repeats`, `averaged`, `divergence-free` (with
    `moving` walls), `tensile`, `walls`, `emitter`, `sink`, `swept`, kinds of colliders with `friction` and
    `restitution`, `gravity`, `drag`, `held-back`, those of OF_FLUIDS, forces on single particles.
    """
    parts, fluids = force_features(scene, live), scene.fluids.values()
    parts |= {kind for kind, _ in scene.colliders}
    moves = any(any(one.velocity) or any(getattr(one, "spin", ())) for _, one in scene.colliders)
    wanted = {
        "flat": scene.dimensions == 2,
        "fluids": len(fluids) > 1 or solids,
        "solids": solids,
        "repeats": scene.domain is not None,
        "averaged": scene.method.scheme == "averaged",
        "divergence-free": scene.method.scheme == "divergence-free",
        "moving": scene.method.scheme == "divergence-free" and moves,
        "tensile": scene.method.tensile_correction > 0,
        "walls": bool(parts & set(WALLS)),
        "swept": bool(parts & {"capsule", "box"}),
        "friction": any(collider.static_friction > 0 for _, collider in scene.colliders),
        "restitution": any(collider.restitution > 0 for _, collider in scene.colliders),
        "gravity": scene.gravity is not None and (scene.gravity.enabled or "gravity" in live),
        "drag": any(part.drag > 0 or part.free_surface_drag > 0 for part in fluids),
        "emitter": bool(scene.emitters),
        "sink": bool(scene.sinks),
        "held-back": any(part.maximum_acceleration is not None for part in fluids),
    }
    wanted |= {name: any(getattr(part, field) > 0 for part in fluids) for name, field in OF_FLUIDS.items()}
    return frozenset(parts | {name for name, there in wanted.items() if there})


def neighbours_at_rest(scene: Scene) -> float:
    """Return the approximate number of neighbours of an interior particle."""
    across = scene.fluid_set.support / scene.fluid_set.spacing
    return (pi * across**2 if scene.dimensions == 2 else 4 / 3 * pi * across**3) - 1


def fluid_plan(scene: Scene, live: frozenset[str] = frozenset(), solids: bool = False) -> Plan:
    """Return the plan of a step; `solids`: for a fluid that interacts with solids.

    Numbers are per particle and axis, as in model/core/plan.py, with as many neighbours as at rest.
    """
    parts, axes = fluid_parts(scene, live, solids), scene.dimensions
    counts = {
        "particle": 1, "axis": axes, "neighbour": neighbours_at_rest(scene), "sink": len(scene.sinks),
        "candidate": LOOKED_AT[axes] * (scene.fluid_set.support / scene.fluid_set.spacing) ** axes,
        "force": sum(force.operations for force in particle_forces(parts)),
        "collider": sum(colliders.OPERATIONS[kind] for kind, _ in scene.colliders),
    }  # fmt: skip
    method = scene.method
    stages = stages_of(substep_of(parts), method.iterations, counts)
    root = Node("step", (Node("substep", stages, method.substeps),))
    scalars = sum(stage.reads + stage.writes for stage in root.stages())
    return Plan(root, scalars, parts, dimensions=axes)
