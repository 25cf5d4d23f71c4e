"""How far a substep of a fluid reads, so that several can share it by slabs of space (model/domains/slabs.py)."""

from __future__ import annotations

from model.core.errors import SceneError
from model.fluid.parameters import speed_limit
from model.fluid.plan import SHAPES, SMOOTHING, fluid_parts
from model.scene.fluid import WIDER
from model.scene.scene import Scene

APART = "is not shared among processes or GPUs yet"


def fluid_supports(scene: Scene) -> int:
    """From neighbour to neighbour, how many of them lie between a particle and what it may hang on within a substep.

    Lists are made once, of predicted places. An iteration's `density` looks at neighbours, and `correct` at their changes,
    which looked at theirs: two an iteration. Velocities are smoothed over neighbours, whose normals and vorticity are of
    theirs (model/fluid/plan.py, 4 to 8).
    """
    parts = fluid_parts(scene)
    return 2 * scene.method.iterations + bool(parts & SMOOTHING) + bool(parts & SHAPES)


def fluid_halo(scene: Scene) -> float:
    """[m]: how far from a slab particles lie, as a substep begins, that those in it hang on: each support is one of predicted
    places, and both ends are predicted no farther than the fastest goes in a substep. Raises SceneError for what cannot be
    shared yet."""
    for kind, name in [("emitter", name) for name in scene.emitters] + [("sink", name) for name in scene.sinks]:
        raise SceneError(f"{name}.kind", kind, f"{APART}: run it as one")
    if scene.foam is not None:
        raise SceneError(f"{scene.name_of('foam')}.kind", "foam", f"{APART}: leave it out")
    if scene.method.scheme == "divergence-free":
        raise SceneError("method.scheme", "divergence-free", f"{APART}: use macklin")
    h = scene.method.dt / scene.method.substeps
    fastest = max(speed_limit(scene, part) for part in scene.fluids.values())
    return WIDER * (fluid_supports(scene) * scene.fluid_set.support + 2 * h * fastest)
