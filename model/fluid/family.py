"""The family of position-based fluids."""

from __future__ import annotations

from math import hypot, inf, sqrt

from softlab.model.core.family import SolverFamily
from softlab.model.core.stability.laws import RESTS
from softlab.model.fluid.fields import of_fluids
from softlab.model.fluid.halo import fluid_halo
from softlab.model.fluid.measure import density_errors
from softlab.model.fluid.parameters import fluid_record, highest_viscosity, speed_limit
from softlab.model.fluid.plan import fluid_plan
from softlab.model.fluid.shear import shear_lines
from softlab.model.fluid.speeds import expected_speeds, speed_lines
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import COLLIDER_KINDS, Collider

SPRINGS = 0.09  # u h / (d sqrt(iterations)) above which the averaged scheme throws drops of the speed u back


def shift_by_gravity(scene: Scene) -> float:
    """Distance [rest distances] that gravity moves a particle by in one substep: g h^2 / d."""
    if scene.gravity is None or not scene.gravity.enabled:
        return 0.0
    h = scene.method.dt / scene.method.substeps
    return abs(scene.gravity.acceleration) * h * h / scene.fluid_set.spacing


def comes_to_rest(scene: Scene) -> bool:
    """True if water in a tank comes to rest with the scene's scheme at its substep (tests/public/test_still_water.py).
    `averaged` and `divergence-free` start each substep without pressure, and need short substeps to come to rest."""
    return scene.method.scheme == "macklin" or shift_by_gravity(scene) <= RESTS


def springs_back(scene: Scene) -> bool:
    """Return True if a drop may rebound from a collider with more than a tenth of its speed u. // The iterations of
    `averaged` damp nothing: n of them in a substep act as a medium with a speed of sound of about sqrt(n) d / h, which
    rebounds if u exceeds SPRINGS of that (measured: tests/public/test_splishsplash_103.py).

    The iterations of `averaged` take back nothing; n of them in a substep make a medium whose sound travels at about
    sqrt(n) d / h, and it springs back where u exceeds SPRINGS of that (measured: tests/public/test_splishsplash_103.py).
    """
    if scene.method.scheme != "averaged" or not scene.colliders:
        return False
    speed = max(speed for speed, _ in expected_speeds(scene).values())
    h = scene.method.dt / scene.method.substeps
    return speed * h > SPRINGS * scene.fluid_set.spacing * sqrt(scene.method.iterations)


def scheme_notes(scene: Scene) -> list[str]:
    """Return notes on what the scheme cannot do in this scene: come to rest at its substep, or stop at colliders."""
    scheme, notes = scene.method.scheme, []
    if springs_back(scene):
        notes.append(
            f"colliders may throw drops back at more than a tenth of their speed with the scheme {scheme} at this effort; "
            "use more substeps or iterations, or macklin"
        )
    if not comes_to_rest(scene):
        notes.append(
            f"water does not come to rest with the scheme {scheme} at this substep: gravity moves a particle by "
            f"{shift_by_gravity(scene):.2g} rest distances in one, more than {RESTS:g}; use more substeps or macklin"
        )
    return notes


def fluid_note(scene: Scene) -> str:
    """Return a line on the method's effect on a motion, and on its limits."""
    slowest = min(speed_limit(scene, part) for part in scene.fluids.values())
    solved_for = "positions"
    if scene.method.scheme == "divergence-free":
        solved_for = (
            f"velocities, {scene.method.iterations} iterations for their divergence and as many for the density to come"
        )
    note = f"density is kept by {solved_for}, at any step size; nothing is faster than {slowest:.3g} m/s"
    for name, part in scene.fluids.items():
        most = highest_viscosity(scene, part)
        if part.viscosity > most:
            note += f"; of {name}.viscosity only {most:.3g} Pa s act at this substep"
    if scene.method.scheme == "averaged":
        note += "; the averaged scheme lets a fluid be compressed by its weight"
    note = "; ".join([note, *scheme_notes(scene)])
    for name, part in scene.fluids.items():
        if part.surface_tension > 0 and part.cohesion == 0:
            note += f"; {name}.surface_tension without cohesion drives its surface apart"
    fast = [name for name, part in scene.parts_of(Collider).items() if hypot(*part.velocity) > slowest]
    if fast:
        note += f"; {' and '.join(fast)} is faster than that: it pushes the fluid on, which lags behind"
    return note


def fluid_warnings(scene: Scene) -> list[str]:
    """Return lines on fluids, also those of a world, that are too fast for their substeps, or whose lattice resists shear."""
    return speed_lines(scene) + shear_lines(scene)


FLUID = SolverFamily(
    name="fluid",
    knows=frozenset({"fluid", "emitter", "sink", "domain", "foam", "gravity", "external", "method", *COLLIDER_KINDS}),
    accepts=lambda scene: bool(scene.fluids),
    plan=fluid_plan,
    record=fluid_record,
    limit=lambda scene, frequency: inf,
    limited_by_net=False,
    note=fluid_note,
    scheme_note=lambda scene: "; ".join(scheme_notes(scene)),
    stored=lambda scene, position, arrays: (0.0, {}),
    strain=lambda scene, position, kind, arrays: density_errors(scene, position),
    spring_count=lambda scene: 0,
    solvers={"cpu": "softlab.cpu_backend.fluid.solver:Fluid", "gpu": "softlab.gpu_backend.fluid.solver:Fluid"},
    passes={"cpu": "softlab.app.plan.fluid:fluid_on_cpu", "gpu": "softlab.app.plan.fluid_gpu:fluid_on_gpu"},
    reference="softlab.bench.reference.fluid",
    warnings=fluid_warnings,
    fields=of_fluids,
    presentation="softlab.app.families.fluid:FLUID",
    halo=fluid_halo,
    unknown="a fluid's particles have no converged reference; the density error is reported instead",
)
