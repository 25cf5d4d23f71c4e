"""Report of the demo: the lines of numbers over its picture, and its state for another program."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from softlab.app.presentation import presentation_of
from softlab.app.render.camera import Camera
from softlab.app.window.demo import Demo
from softlab.app.window.live import stiffness_paths
from softlab.app.window.panes import Pane
from softlab.model.base.files import replacing
from softlab.model.core.families import family_of
from softlab.model.core.simulation import Simulation
from softlab.model.core.spare import counts, present
from softlab.model.scene.scene import Scene

FAR = 100  # steps: a limit beyond so many tells nothing of this step


def milliseconds(seconds: float) -> str:
    """Return milliseconds with at least three digits."""
    value = 1e3 * seconds
    return f"{value:.0f} ms" if value >= 1000 else f"{value:.3g} ms"


def numbers_text(
    demo: Demo, frame_seconds: float, draw_seconds: float, drawing_path: str = "", brief: bool = False
) -> str:
    """Return three lines, the most important first: time and speed; settings and energy; backend and timings.

    `frame_seconds`, `draw_seconds`: of a frame, smoothed. `drawing_path`: how it is drawn, if there are several ways.
    `brief`: omits what the open panel shows.
    """
    if demo.compiling is not None:
        return (
            f"compiling this scene: {demo.compiling:.0f} s so far\n"
            "the result is cached for the next run; only Escape, A, H, N and V work until then"
        )
    world, scene = demo.world, demo.world.scene
    threads = (
        f"{world.threads} threads ({demo.threads})" if world.backend == "cpu" else f"{world.threads} threads per block"
    )
    stiffness = "/".join(f"{value:.4g}" for value in stiffness_paths(scene).values())
    springs = f"stiffness {stiffness} N/m   " if stiffness else ""
    state = "   DIVERGED" if demo.frozen else "   paused" if demo.paused else ""
    state += f"   INCOMPLETE: {demo.statistics.faults}" if demo.statistics.faults else ""
    gravity = "on" if demo.gravity else "off"
    drawing_path = f" ({drawing_path})" if drawing_path else ""
    whose = f"{demo.titles[demo.current]}: " if len(demo.worlds) > 1 else ""
    steps = demo.steps_of(world)
    physics, drawing = milliseconds(demo.physics_seconds), milliseconds(draw_seconds)
    details = f"   gravity {gravity}   {springs}energy {demo.statistics.energy:.4g} J   {strain_text(demo)}"
    limit = "" if FAR * scene.method.dt < world.limit < math.inf else f", {demo.limit_text()}"
    masses = f"   {masses_text(scene, world.body.inverse_mass)}"
    return "\n".join(
        (
            f"{whose}time {world.time:.2f} s   {rates_text(demo, frame_seconds)}{state}",
            f"dt {scene.method.dt:.4g} s{limit} ({scene.method.name}){'' if brief else details}",
            f"{world.backend}, {threads}, {world.options.precision}{'' if brief else masses}   "
            f"per frame: {steps} step{'s' * (steps != 1)}, physics {physics}, drawing {drawing}{drawing_path}",
        )
    )


def rates_text(demo: Demo, frame_seconds: float) -> str:
    """Return frames and steps per second, and the real-time factor: simulated seconds per second of wall time."""
    speed, steps = 1 / max(frame_seconds, 1e-6), demo.steps_of(demo.world)
    frames = f"{speed:.0f} frame{'s' * (round(speed) != 1)}/s"
    if demo.paused or demo.frozen:
        return f"{frames}   0 steps/s"
    factor = speed * steps * demo.world.scene.method.dt
    return f"{frames}   {speed * steps:.0f} steps/s   {factor:.{'2g' if factor < 99 else '0f'}}x real time"


def gravity_of(scene: Scene) -> float:
    """Return the downward acceleration [m/s^2]; 0 if gravity is off."""
    return scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0


def title_text(demo: Demo, number: int) -> str:
    """Return the title of a world beside others, with the settings that may differ."""
    world = demo.worlds[number]
    gravity, method = gravity_of(world.scene), world.scene.method
    stiffness = "/".join(f"{value:.4g}" for value in stiffness_paths(world.scene).values())
    lines = [
        demo.titles[number] + ("   (keys change this one)" if demo.alone and number == demo.current else ""),
        (f"gravity {gravity:g} m/s²" if gravity else "gravity off")
        + f"   dt {method.dt:.4g} s"
        + ("   OVER its limit" if method.dt > world.limit * (1 + 1e-12) else ""),
        *([f"stiffness {stiffness} N/m"] if stiffness else []),
    ]
    return "\n".join(lines)


def strain_text(demo: Demo) -> str:
    """Return the worst strain, the largest distance of a body's particle from its goal, or the compression and speed of
    a fluid."""
    text = presentation_of(demo.world.scene).worst_text
    return text(demo.statistics.worst_strain, demo.statistics.fastest)


def counts_of(world: Simulation) -> dict[str, int]:
    """Return the number of particles, bodies, clusters and so on of a world, by name."""
    scene = world.scene
    totals, springs = counts(scene, world.body.inverse_mass), family_of(scene).spring_count(scene)
    of_family = presentation_of(scene).counts(scene)
    amounts = {
        "Particles": totals.particles,
        "Bodies": totals.bodies if scene.copies else of_family.get("bodies", 0),
        "Inactive bodies": totals.waiting,
        "Clusters": totals.clusters,
        "Tetrahedra": of_family.get("tetrahedra", 0),
        "Springs": 0 if "tetrahedra" in of_family else springs,
        "Colliders": len(scene.colliders),
    }
    return {name: count for name, count in amounts.items() if count or name == "Particles"}


def masses_text(scene: Scene, inverse_mass: np.ndarray | None = None) -> str:
    """Return the number of masses in words, with clusters, active and inactive bodies, and colliders.

    `inverse_mass`, as in State, marks inactive bodies (None: when the scene starts).
    """
    colliders = len(scene.colliders)
    text = presentation_of(scene).brief(scene, counts(scene, inverse_mass))
    return text + (f", {colliders} collider{'s' * (colliders > 1)}" if colliders else "")


def demo_state(demo: Demo, camera: Camera, pane: Pane, height: int) -> dict[str, object]:
    """Return the state of the demo as plain JSON values.

    Most are of the current world, which is drawn in `pane` of a window `height` pixels high; `worlds` has the numbers
    of each title. `masses`: for the corners, the middle and the selected mass, the position in the `window` (pixels
    from its upper left corner) and the `position` [m]; `mean`, `low`, `high` [m] of all positions of active bodies;
    `waiting`: number of inactive bodies.
    """
    world, position, poke = demo.world, demo.position, demo.picker.poke
    columns, last = world.body.columns, len(position) - 1
    sample = {0, columns - 1, world.body.rows // 2 * columns + columns // 2, last - columns + 1, last}
    if demo.picker.selected is not None:
        sample.add(demo.picker.selected)
    masses = {}
    for particle in sorted(sample):
        if np.isfinite(position[particle]).all():
            x, y = camera.to_window(position[particle])
            metres = position[particle].tolist()
            if np.isfinite((x, y)).all():  # in space a mass can lie behind the viewer
                masses[str(particle)] = {
                    "window": [pane.left + float(x), height - pane.bottom - float(y)],
                    "position": metres,
                }
    active = present(world.scene, position, world.body.inverse_mass)
    finite = active[np.isfinite(active).all(axis=1)].astype(np.float64)
    some = finite if len(finite) else np.zeros((1, world.scene.dimensions))
    stiffness = list(stiffness_paths(world.scene).values())
    return {
        "backend": demo.backend,
        "device": world.device,
        "threads": demo.threads,
        "thread_count": world.threads,
        "gravity": demo.gravity,
        "dt": world.scene.method.dt,
        "limit": world.limit if math.isfinite(world.limit) else None,
        "stiffness": stiffness[0] if stiffness else None,
        "steps_per_frame": demo.steps_per_frame,
        "step": world.step,
        "time": world.time,
        "paused": demo.paused,
        "diverged": demo.frozen,
        "failure": demo.failure,
        "incomplete": demo.statistics.faults,
        "message": demo.message,
        "message_count": demo.message_count,
        "selected": demo.picker.selected,
        "poke": {"particle": poke.particle, "force": list(demo.force())} if poke else None,
        "energy": demo.statistics.energy,
        "worst_strain": None if math.isnan(demo.statistics.worst_strain) else demo.statistics.worst_strain,
        "mean": some.mean(axis=0).tolist(),
        "low": some.min(axis=0).tolist(),
        "high": some.max(axis=0).tolist(),
        "masses": masses,
        "waiting": counts(world.scene, world.body.inverse_mass).waiting,
        "current": demo.current,
        "alone": demo.alone,
        "worlds": [
            {"title": title, "gravity": gravity_of(w.scene), "dt": w.scene.method.dt, "step": w.step, "time": w.time}
            for title, w in zip(demo.titles, demo.worlds, strict=True)
        ],
    }


def write_state(path: Path, state: dict[str, object]) -> None:
    """Replace the JSON file `path` atomically, so that a reader never sees a part of it."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(state), encoding="utf-8")
