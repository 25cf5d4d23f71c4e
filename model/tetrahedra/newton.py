"""The family of tetrahedral bodies by implicit Euler, solved by Newton's method: its constants and plan.

At order 2 a substep is two such solves, each of a part of it (model/formulas/elastic/stages.py); h is then the length
of that part. A substep of h minimises the incremental potential (S. Martin et al., "Example-Based Elastic Materials",
ACM TOG 2011, eq. 3)
  sum m / (2 h^2) |x - y|^2 + sum V (W(F(x)) + tau / (2 h) (E - E_0) : C : (E - E_0)),    y = x_0 + h v_0 + h^2 a,
with E Green's strain, E_0 that of the substep's start, C the moduli at rest, and tau the body's damping [s]
(model/formulas/elastic/damper.py). There are at most `iterations` Newton steps, each by conjugate gradients
(cpu_backend/tetrahedra/newton.py, gpu_backend too).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from softlab.model.base.clock import START, Clock
from softlab.model.base.errors import SceneError
from softlab.model.base.types import Real
from softlab.model.contact.substep_parameters import XPBD_FIELDS, xpbd_values
from softlab.model.core.family import Field, counter
from softlab.model.core.own_forces import particle_forces
from softlab.model.core.parameters import rounded_record
from softlab.model.core.plan import Node, Plan, Stage
from softlab.model.core.stability.projection import projection_limit, with_limit
from softlab.model.formulas import colliders, distance
from softlab.model.formulas.constraints.tetrahedron import MATERIALS
from softlab.model.formulas.elastic import deformation, newton, stages, tangent
from softlab.model.geometry.arithmetic.ordered import total
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.position_based.mesh_plan import PINS, with_friction_in_place
from softlab.model.scene.checks.tetrahedra import NOT_SMOOTH
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.apart import none_apart
from softlab.model.tetrahedra.constraints import tetrahedra_parts, through_note
from softlab.model.tetrahedra.family import TETRAHEDRA
from softlab.model.tetrahedra.material import rest_ratio

CONSTANTS = ("newton_inertia", "newton_rate")  # of the record: the mean mass over h^2 [kg/s^2], 1 / h [1/s]
VALUES = 14  # of a tetrahedron: 9 of B [1/m], V [m^3], mu, lambda [Pa], alpha of the neo-Hookean material, tau [s]
AT_VOLUME, AT_MU, AT_LAME, AT_ALPHA, AT_DAMPING = range(9, VALUES)
SUMMED = 64  # tetrahedra, or particles, with one partial sum, whichever thread computes it
DAMPED, STAGED = "tetrahedra-damping", "two-stages"  # parts of a plan
PRODUCTS = "conjugate gradients, until the residual is small enough"


def element_values(body_set: TetrahedraSet) -> np.ndarray:
    """Return the values of tetrahedra, (tetrahedra, VALUES) float64."""
    mu, lame = body_set.lame()
    damping = body_set.matter.damping
    return np.column_stack(
        [body_set.rest_inverse.reshape(-1, 9), body_set.volume, mu, lame, rest_ratio(mu, lame), damping]
    )  # fmt: skip


def holding(body_set: TetrahedraSet) -> np.ndarray:
    """Return the stiffness of the tetrahedra at each particle at rest, along the axis where it is largest, (particles,)
    [N/m]."""
    mu, lame = body_set.lame()
    rows = np.concatenate([-body_set.rest_inverse.sum(axis=1, keepdims=True), body_set.rest_inverse], axis=1)
    each = ((2 * mu + lame) * body_set.volume)[:, None] * (rows**2).sum(axis=2)
    return np.bincount(body_set.tetrahedra.ravel(), each.ravel(), body_set.particle_count)


def rounding_floor(body_set: TetrahedraSet, real: Real) -> float:
    """Return the residual [J], in the norm of the inverse diagonal blocks, below which iterations stop.

    It is that of strains of a tenth of the rounding error.
    """
    mu, lame = body_set.lame()
    return float((0.1 * np.finfo(real).eps) ** 2 * total((2 * mu + lame) * body_set.volume))


def newton_parts(scene: Scene, live: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return the parts that need code: those of a position-based scene without the materials, which are values of
    tetrahedra."""
    more = {STAGED} if scene.method.order > 1 else set()
    return with_friction_in_place(tetrahedra_parts(scene, live) - set(MATERIALS) | more)


def stages_of(scene: Scene) -> int:
    """Return the number of implicit Euler solves per substep."""
    return scene.method.order


def stage_vectors(parts: frozenset[str]) -> int:
    """Return the number of vectors that the second stage of order 2 needs.

    The velocities at the first one's start; with dampers, the positions at its start and end, too.
    """
    return (1 + 2 * (DAMPED in parts)) if STAGED in parts else 0


def solved(scene: Scene) -> Scene:
    """Return the scene of which each solve is one substep, with another step size if a substep has several.

    Nothing may depend on its time, since stages do not end where substeps would.
    """
    return scene if scene.method.order == 1 else scene.stepped(dt=stages.STAGE * scene.method.dt)


def refuse_unsteady(scene: Scene, live: frozenset[str]) -> None:
    """Raise SceneError for targets of pins that change while running, which have no second order in time."""
    if scene.method.order > 1 and "targets" in live:
        raise SceneError("live", "targets", f"{NOT_SMOOTH}: --set method.order=1")


def newton_record(
    scene: Scene, real: Real, poke: tuple[float, ...] = (0.0, 0.0, 0.0), clock: Clock = START
) -> np.ndarray:
    """Return CONSTANTS, then those of every position-based solver, (1,); h is the length of a solve."""
    one = solved(scene)
    h = one.method.dt / one.method.substeps
    constants = dict(zip(CONSTANTS, (scene.grid.mass / h**2, 1 / h), strict=True))
    return rounded_record(scene, constants | xpbd_values(one, poke, clock), XPBD_FIELDS, real)


def newton_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """Return the plan of a step. Residuals decide how often its inner node runs: bytes and operations are of one pass
    each."""
    refuse_unsteady(scene, live)
    parts, method, body_set = newton_parts(scene, live), scene.method, scene.tetrahedra_set
    particles = body_set.particle_count
    each = len(body_set.tetrahedra) / particles  # tetrahedra per particle
    blocks = 1 + 2 * len(body_set.edges[0]) / particles
    turns = deformation.OPERATIONS_ROTATION[4]
    forces = 3 * distance.OPERATIONS_PREDICT + ("gravity" in parts)
    forces += sum(force.operations + 3 for force in particle_forces(parts) if force.operations)
    evaluation = Stage("forces and energy of tetrahedra", 4, 2, round(each * (turns + tangent.OPERATIONS_STRESS)) + 20)
    shape = tangent.operations_axes(4) + tangent.OPERATIONS_MODULI + 6 * tangent.OPERATIONS_BLOCK
    rows = Stage("rows of the matrix", round(each * 30), round(3 * blocks), round(each * (turns + shape + 16 * 9)))
    solve = Node(
        PRODUCTS,
        (
            Stage("product with the matrix", round(3 * blocks) + 1, 1, round(18 * blocks) + 6),
            Stage("update of the solution", 8, 4, 12 + 15 + 12),
        ),
    )
    newton = Node("iteration", (rows, solve, Stage("move", 2, 1, 6), evaluation), method.iterations)
    pins = (PINS,) if "motion" in parts else ()
    last: list[Node | Stage] = [Stage("update velocity", 2, 1, 3 * distance.OPERATIONS_UPDATE), *pins]
    if scene.colliders:
        touched = sum(colliders.OPERATIONS[kind] for kind, _ in scene.colliders)
        last.append(Stage("collide", 2, 2, touched, 1.0))
    solves: list[Node | Stage] = [Stage("predict", 2, 3, forces), *pins, evaluation, newton, *last]
    if STAGED in parts:
        between = Stage("begin of a stage", 3, 2, stages.OPERATIONS_AHEAD)
        solves = [Node("stage", (between, *solves), stages_of(scene))]
    root = Node("step", (Node("substep", tuple(solves), method.substeps),))
    return Plan(root, sum(stage.reads + stage.writes for stage in root.stages()), parts, dimensions=3)


def newton_limit(scene: Scene, frequency: float | None = None) -> float:
    """Return the limit [s] of projections (model/xpbd/family.py).

    At order 2 the two stages are stable with an explicit damper while h c / m < 1 / (g (1 - g)), for any vibrations,
    from R(z) = 1 - z + g (1 - g) z^2 with z = h c / m.
    """
    limit = projection_limit(scene, frequency)
    return limit if scene.method.order == 1 else limit / (2 * stages.STAGE * (1 - stages.STAGE))


def newton_note(scene: Scene) -> str:
    """Return a line on the method's effect on a motion, and on the limit of the step size, if there is one."""
    text = "implicit Euler by Newton's method, at any step size: first order, and damped by it"
    if scene.method.order > 1:
        text = (
            "two stages by Newton's method, at any step size: second order, and hardly damped; dampers of masses are of"
            " first order"
        )
    return with_limit(scene, text) + through_note(scene)


def _per_solve(name: str, place: int, doc: str) -> Field:
    """Return the mean per solve (a substep is one, at second order two) of the count at index `place` of `done`."""

    def count(simulation: Any) -> float:
        done = simulation.done
        return float(done[place] / max(done[newton.DONE.SOLVES], 1))

    return counter(name, f"{doc} per solve", count)


PER_SOLVE = (
    _per_solve("matrices", newton.DONE.MATRICES, "matrices"),
    _per_solve("newton_steps", newton.DONE.STEPS, "steps of Newton's method"),
    _per_solve("matrix_products", newton.DONE.PRODUCTS, "products with the matrix"),
)


def _fields(scene: Scene) -> tuple[Field, ...]:
    return *TETRAHEDRA.fields(scene), *PER_SOLVE


TETRAHEDRA_NEWTON = replace(
    TETRAHEDRA,
    name="tetrahedral body, implicit",
    accepts=lambda scene: bool(scene.tetrahedra) and scene.method.solver == "newton",
    plan=newton_plan,
    record=newton_record,
    note=newton_note,
    limit=newton_limit,
    solvers={
        "cpu": "softlab.cpu_backend.tetrahedra.newton:TetrahedraNewton",
        "gpu": "softlab.gpu_backend.tetrahedra.newton:TetrahedraNewton",
    },
    passes={"cpu": "softlab.app.plan.mesh:newton_on_cpu", "gpu": "softlab.app.plan.mesh:newton_on_gpu"},
    reference="softlab.bench.reference.tetrahedra_newton",
    fields=_fields,
    apart=none_apart,
    partitions=none_apart,
)
