"""The distance that a substep of a fluid reads, for slabs of space (model/domains/slabs.py)."""

from __future__ import annotations

from softlab.model.base.errors import SceneError
from softlab.model.fluid.parameters import speed_limit
from softlab.model.fluid.passes import SHAPES, SMOOTHING
from softlab.model.fluid.plan import fluid_parts
from softlab.model.scene.scene import Scene
from softlab.model.tables.fluid import WIDER

APART = "is not supported on several GPUs or processes"


def fluid_supports(scene: Scene) -> int:
    """Return the number of supports between a particle and the farthest one on which it may depend within a substep.

    Lists are made once, from predicted positions. An iteration's `density` reads neighbours, and `correct` their
    changes, which read theirs: two supports per iteration. Velocities are smoothed over neighbours, whose normals and
    vorticity depend on theirs (model/fluid/plan.py, 4 to 8).
    """
    parts = fluid_parts(scene)
    return 2 * scene.method.iterations + bool(parts & SMOOTHING) + bool(parts & SHAPES)


def fluid_halo(scene: Scene) -> float:
    """Return the largest distance [m] from a slab, at the start of a substep, of particles on which its own depend.

    Each support is one of predicted positions, and the prediction moves both ends by at most the speed limit times a
    substep. Raises SceneError for parts that are not supported.
    """
    for kind, name in [("emitter", name) for name in scene.emitters] + [("sink", name) for name in scene.sinks]:
        raise SceneError(f"{name}.kind", kind, f"{APART}; run the scene on one")
    if scene.foam is not None:
        raise SceneError(f"{scene.name_of('foam')}.kind", "foam", f"{APART}: leave it out")
    if scene.method.scheme == "divergence-free":
        raise SceneError("method.scheme", "divergence-free", f"{APART}: use macklin")
    h = scene.method.dt / scene.method.substeps
    fastest = max(speed_limit(scene, part) for part in scene.fluids.values())
    return WIDER * (fluid_supports(scene) * scene.fluid_set.support + 2 * h * fastest)
