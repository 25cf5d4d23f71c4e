"""Plan of a fluid's step on each backend, and meaning of its parameters, for `softlab plan`."""

from __future__ import annotations

from collections.abc import Iterable

from softlab.app.plan.passes import BackendPlan, cpu_plan, merged_passes
from softlab.model.base.words import notes_of
from softlab.model.core.plan import Plan, Stage
from softlab.model.fluid.flow import rates
from softlab.model.fluid.parameters import MAX_NEIGHBOURS, smoothing, speed_limit
from softlab.model.fluid.passes import runs_of
from softlab.model.fluid.plan import neighbours_at_rest, substep_of
from softlab.model.scene.checks.flow import fluid_of
from softlab.model.scene.scene import Scene


def fluid_on_cpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a CPU: neighbour lists, sixteen particles per vector, one parallel region for all substeps of
    a call."""
    from softlab.cpu_backend.fluid.passes import fused_passes

    why = "sorted by cells in every substep, neighbour lists in slices; all substeps of a call in one kernel"
    groups = fluid_groups(scene, plan, fused_passes(plan.parts))
    return cpu_plan("fused", why, merged_passes(groups, plan, precision, "one phase of the thread team"))


def fluid_groups(scene: Scene, plan: Plan, fused: Iterable[tuple[str, ...]]) -> list[list[Stage]]:
    """Return the stages of each kernel of a substep, in order, where kernels do the runs of passes `fused` at once."""
    stages = {stage.name: stage for stage in plan.root.stages()}
    runs = runs_of(substep_of(plan.parts), scene.method.iterations, fused)
    return [[stages[name] for name in passes] for passes in dict.fromkeys(run.passes for run in runs)]


def fluid_lines(scene: Scene) -> list[str]:
    """Return one line per parameter of a scene's fluids, with value, unit and meaning, and derived quantities."""
    if not scene.fluids:
        return []
    fluid_set, lines = scene.fluid_set, []
    neighbours = f"{neighbours_at_rest(scene):.0f} neighbours at rest, {MAX_NEIGHBOURS[scene.dimensions]} at most"
    lines.append(f"fluids: {fluid_set}; support {fluid_set.support:g} m, {neighbours}")
    for name, part in scene.fluids.items():
        notes = notes_of(type(part))
        for field, value in part.model_dump().items():
            if field in ("origin", "size", "capacity", "blocks", "dimensions", "velocity", "vortices"):
                continue
            text = "none" if value is None else f"{value:g}"
            if field == "support" and value is None:
                text = f"{part.support_radius:g}"
            lines.append(f"  {name}.{field} = {text}  ({notes.get(field, '')})")
        removed, mass = smoothing(scene, part), part.density * fluid_set.spacing**fluid_set.dimensions
        lines.append(
            f"  of {name}: speed limit {speed_limit(scene, part):.4g} m/s (half a support radius per substep); XSPH removes "
            f"{removed:.3g} of a velocity difference; particle mass {mass:.4g} kg"
        )
    return lines + flow_lines(scene)


def flow_lines(scene: Scene) -> list[str]:
    """Return lines about capacities, emitters (rate, time until the capacity is reached) and sinks."""
    lines, fluid_set, names = [], scene.fluid_set, list(scene.fluids)
    for number, name in enumerate(names):
        if fluid_set.capacities[number] > fluid_set.starting[number]:
            lines.append(
                f"  {name}: {fluid_set.starting[number]} particles at the start, {fluid_set.capacities[number]} at most"
            )
    for name, part in scene.emitters.items():
        volume, each_second, points = rates(scene, name)
        fluid = fluid_of(scene, name)
        line = f"  {name}: {names[fluid]} from a nozzle of {points} particles, {part.speed:g} m/s: {volume:.4g} m^3/s, "
        line += f"{each_second:.4g} particles/s"
        waiting = fluid_set.capacities[fluid] - fluid_set.starting[fluid]
        if each_second:
            lasts = part.start + waiting / each_second
            ends = part.stop is not None and part.stop < lasts
            line += (
                f", until {part.stop:g} s"
                if ends
                else f"; all {waiting} inactive particles are emitted by {lasts:.3g} s"
            )
        lines.append(line)
    if scene.sinks:
        lines.append(
            f"  {' and '.join(scene.sinks)} remove the particles that reach them; an emitter of the same fluid reuses them"
        )
    return lines
