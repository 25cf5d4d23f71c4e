"""Parts of a scene that can be left out, and settings that can be cheaper, one at a time: input of `softlab ablate`.

Everything is derived from the scene. Each optional force or constraint that has an effect can be dropped; method and
arithmetic can be made cheaper. A new part needs no change here; a new setting of `[method]` is one more function in
`ENTRIES`. The full scene runs in float64 and exact math, the highest accuracy of the lab.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from softlab.model.base.errors import SceneError
from softlab.model.core.families import scene_plan
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import Scene

FULL_PRECISION, FULL_MATH = "float64", "exact"
NOT_LEFT_OUT = ("method", "perturbation")  # kinds that are neither force nor constraint: the method and the start
PART, INTEGRATOR, ARITHMETIC, COARSER, FINER = (
    "part",
    "integrator",
    "arithmetic",
    "coarser",
    "finer",
)  # values of `kind`


@dataclass(frozen=True)
class Ablation:
    """One change of a scene.

    `name`: of the run, e.g. `without gravity`; `why`: the reason why it may be cheaper; `kind`: `PART` ... `FINER`;
    `spares`: the part that is left out, e.g. `gravity`; `drop`: the name of a part, or empty; `changes`: of other
    fields, by dotted path.
    """

    name: str
    why: str
    kind: str
    spares: str
    drop: str = ""
    changes: Mapping[str, object] = field(default_factory=dict)
    precision: str = FULL_PRECISION
    math: str = FULL_MATH

    def of(self, scene: Scene) -> Scene:
        """Return the scene with this change. Raises SceneError if the scene is invalid without the part."""
        tables = {name: table for name, table in scene.as_dict().items() if name != self.drop}
        return Scene(tables, scene.name).replace(self.changes)


FULL = Ablation("full scene", f"{FULL_PRECISION}, {FULL_MATH} math", "full", "nothing")


def _parts(scene: Scene) -> Iterator[Ablation]:
    for name, kind in scene.kinds.items():
        if kind in NOT_LEFT_OUT:
            continue
        part = Ablation(f"without {name}", "no stage of it", PART, name, drop=name)
        try:
            without = part.of(scene)
        except SceneError:  # a required part: the masses, or what another part depends on
            continue
        if scene_plan(without) != scene_plan(scene):  # a part that is switched off has no stage to drop
            yield part


def _integrators(scene: Scene) -> Iterator[Ablation]:
    if scene.method.position_based or scene.method.integrator not in INTEGRATORS:
        return
    now = INTEGRATORS[scene.method.integrator]
    for other in INTEGRATORS.values():
        if other.forces < now.forces:
            why = f"{other.forces} of {now.forces} force evaluations a step"
            yield Ablation(other.name, why, INTEGRATOR, now.name, changes={"method.integrator": other.name})


def _efforts(scene: Scene) -> Iterator[Ablation]:
    if not scene.method.position_based:
        return
    for name in ("iterations", "substeps"):
        now = getattr(scene.method, name)
        if now > 1:
            half = now // 2
            fewer = f"{half} {name}" if half > 1 else f"1 {name.removesuffix('s')}"
            changed = {f"method.{name}": half}
            yield Ablation(fewer, f"{half} of {now}", INTEGRATOR, f"{now} {name}", changes=changed)


def _arithmetic(_: Scene) -> Iterator[Ablation]:
    yield Ablation("float32", "half the bytes a number", ARITHMETIC, FULL_PRECISION, precision="float32")
    yield Ablation("fast math", "fused and approximate operations", ARITHMETIC, f"{FULL_MATH} math", math="fast")


def _step_sizes(scene: Scene) -> Iterator[Ablation]:
    if random_force(scene):  # a random force is another force at every step size
        return
    dt = scene.method.dt
    yield Ablation(f"dt {2 * dt:g} s", "half the steps", COARSER, f"dt {dt:g} s", changes={"method.dt": 2 * dt})
    yield Ablation(f"dt {dt / 2:g} s", "twice the steps", FINER, f"dt {dt:g} s", changes={"method.dt": dt / 2})


ENTRIES: tuple[Callable[[Scene], Iterable[Ablation]], ...] = (
    _parts,
    _integrators,
    _efforts,
    _arithmetic,
    _step_sizes,
)


def ablations(scene: Scene) -> list[Ablation]:
    """Return all parts that can be left out, all settings that can be cheaper, and the halved step size."""
    return [ablation for entry in ENTRIES for ablation in entry(scene)]


def random_force(scene: Scene) -> bool:
    """True if the scene has a random force, with new random values in every step."""
    return scene.external is not None and scene.external.magnitude > 0
