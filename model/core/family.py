"""The description of a solver family for the rest of the lab, one entry each (model/core/families.py lists them)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from softlab.model.base.clock import Clock
from softlab.model.core.plan import Plan
from softlab.model.core.sharing.bodies import Apart
from softlab.model.core.sharing.decomposition import Stencil
from softlab.model.core.sharing.partitions import SharedMesh
from softlab.model.scene.scene import Scene
from softlab.model.tables.motion import RELEASE


@dataclass(frozen=True)
class Output:
    """An output, computed from the current state when it is read.

    `shape`: in words. `read(simulation, into)` returns it in `into`, or in a new host array if that is None.
    """

    name: str
    shape: str
    unit: str
    doc: str
    read: Callable[[Any, Any], Any]


def on_host(compute: Callable[[Any], np.ndarray]) -> Callable[[Any, Any], Any]:
    """Return the `read` of an output that `compute(simulation)` returns as a new host array."""

    def read(simulation: Any, into: Any) -> Any:
        result = compute(simulation)
        if into is None:
            return result
        into[...] = result
        return into

    return read


@dataclass(frozen=True)
class StateArray:
    """An array of the state that only the simulations of some families have; a field of `State` has its name.

    - `check(scene, array, real)`: the array in the arithmetic `real`, its values unchanged. Raises InputError.
    - `download(simulation)`: a new host array, or None where the scene has none.
    - `upload(simulation, array)`: continue from it; None: from its value in the uploaded state. Called after positions and
      velocities were uploaded.
    """

    name: str
    check: Callable[[Scene, Any, Any], np.ndarray]
    download: Callable[[Any], np.ndarray | None]
    upload: Callable[[Any, np.ndarray | None], None]

    def of(self, member: Any) -> StateArray:
        """Return the array of a member of a world, as one of the world's."""
        return StateArray(
            self.name,
            lambda scene, array, real: self.check(member.scene, array, real),
            lambda world: self.download(member),
            lambda world, array: self.upload(member, array),
        )


POSITION = Output(
    "position", "(particles, dimensions)", "m", "positions", lambda simulation, into: simulation._read_position(into)
)
VELOCITY = Output(
    "velocity", "(particles, dimensions)", "m/s", "velocities", on_host(lambda simulation: simulation._download()[1])
)
STRAIN = Output(
    "strain", "(springs,)", "1", "length over rest length - 1 of springs; (tetrahedra,) of tetrahedra, (particles,) density "
    "over rest density - 1 of fluids", on_host(lambda simulation: simulation._read_strain())
)  # fmt: skip
NORMAL = Output(
    "normal", "(particles, 3)", "1", "unit normals of a surface", lambda simulation, into: simulation._read_normal(into)
)
OF_ALL = (POSITION, VELOCITY)


def of_springs(scene: Scene) -> tuple[Output, ...]:
    """Return the outputs of grids, cloths and meshes."""
    return (STRAIN, NORMAL) if scene.dimensions == 3 else (STRAIN,)


def contacts_lost(simulation: Any) -> dict[str, int]:
    """Return `contacts_lost`, if surfaces of the scene have contacts: contacts, and vertices in the search distance, for
    which a search had no capacity."""
    scene, contacts = simulation.scene, getattr(simulation, "contacts", None)
    if scene.self_collision is None and scene.contact is None:
        return {}
    return {"contacts_lost": int(getattr(contacts, "lost", 0)) + int(getattr(contacts, "neighbours_lost", 0))}


Arrays = Mapping[str, np.ndarray]  # of a state, those of its family, by name
NO_ARRAYS: Arrays = MappingProxyType({})


@dataclass(frozen=True)
class SolverFamily:
    """One way to step one structure of particles, on every backend.

    - `accepts(scene)`: True if this family solves the scene; exactly one family does.
    - `knows`: the kinds of tables that its scenes may have; others are refused.
    - `plan(scene, live)`: the stages of a step.
    - `record(scene, real, poke, clock)`: the constants that kernels read.
    - `limit(scene, frequency)`: the largest stable step size [s]. `frequency` [1/s]: an upper bound of all vibrations,
      where a
      better one is known than `frequency_bound` of model/core/integrators.py.
    - `limited_by_net`: True if that limit depends on the springs' largest frequency.
    - `note(scene)`: a line on the method's effect on a motion.
    - `scheme_note(scene)`: what its scheme cannot do in this scene, or "".
    - `stored(scene, position, arrays)`: the energy [J] in springs or clusters, and of a cloth's springs also by kind.
      `arrays`: those of the state that `state_arrays` declares, by name.
    - `strain(scene, position, kind, arrays)`: the result of read("strain"), (springs,) or (entries,).
    - `spring_count(scene)`: the number of springs, or of what replaces them.
    - `outputs(scene)`: what `read` returns, besides positions and velocities (`Output`).
    - `state_arrays`: what its state has besides positions and velocities (`StateArray`), in the order of their upload.
    - `solvers`, `passes`: by backend, the class that it opens and the function that describes its passes for `softlab
      plan`, as
      `module:name`, since both are in layers above the model.
    - `clusters`: by backend, the class that the solver of position-based sheets iterates in place of constraints, in the
      same way.
    - `presentation`: how its scenes are drawn and described (app/presentation.py), in the same way.
    - `reference`: the module in bench/reference/ whose `simulate` computes its reference.
    - `unknown`: why no converged reference of the motion is known, and what to use instead; None: one is known.
    - `stencil(scene)`: how far a step reads along the rows of its sheet, for sharing by rows (model/domains).
    - `apart(scene)`: the bodies of a scene in which none acts on another, for sharing by bodies
      (model/core/sharing/bodies.py).
    - `halo(scene)`: how far a substep reads [m], for sharing by slabs of space (model/domains/slabs.py).
    - `lost(simulation)`: the counts of contacts or neighbours that did not fit into lists of fixed length, by name.
    - `partitions(scene)`: the meshes of a scene, for sharing by parts of bodies (model/core/sharing/partitions.py).

    The last four raise SceneError for a part that prevents sharing; None: not yet supported for the family.
    """

    name: str
    accepts: Callable[[Scene], bool]
    knows: frozenset[str]
    plan: Callable[[Scene, frozenset[str]], Plan]
    record: Callable[[Scene, Any, tuple[float, ...], Clock], np.ndarray]
    limit: Callable[[Scene, float | None], float]
    limited_by_net: bool
    note: Callable[[Scene], str]
    stored: Callable[[Scene, np.ndarray, Arrays], tuple[float, dict[str, float]]]
    strain: Callable[[Scene, np.ndarray, str, Arrays], np.ndarray]
    spring_count: Callable[[Scene], int]
    solvers: Mapping[str, str]
    passes: Mapping[str, str]
    reference: str
    presentation: str = "softlab.app.families.sheets:SHEET"
    clusters: Mapping[str, str] = field(default_factory=dict)
    outputs: Callable[[Scene], tuple[Output, ...]] = of_springs
    state_arrays: tuple[StateArray, ...] = ()
    scheme_note: Callable[[Scene], str] = lambda scene: ""
    unknown: str | None = None
    stencil: Callable[[Scene], Stencil] | None = None
    apart: Callable[[Scene], Apart] | None = None
    halo: Callable[[Scene], float] | None = None
    partitions: Callable[[Scene], SharedMesh] | None = None
    lost: Callable[[Any], dict[str, int]] = contacts_lost


ANY_SHEET = frozenset(
    {"damping", "gravity", "external", "perturbation", "method", RELEASE}
)  # every sheet supports them
