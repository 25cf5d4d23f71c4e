"""Description of a solver family: one entry per family (listed in model/core/families.py)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from softlab.model.base.clock import Clock
from softlab.model.base.types import Real
from softlab.model.core.plan import Plan
from softlab.model.core.sharing.bodies import Apart
from softlab.model.core.sharing.decomposition import Stencil
from softlab.model.core.sharing.partitions import SharedMesh
from softlab.model.scene.scene import Scene
from softlab.model.tables.motion import RELEASE

Read = Callable[[Any, object], Any]  # (simulation, into)


@dataclass(frozen=True)
class Field:
    """A value that the simulations of a family have under a name: an output, an array of the state, a counter of a run.

    - `rows`: what it has an entry for: "particles", "springs", "clusters", "emitters", or "one", a single number.
    - `shape`: of an entry, in numbers or "dimensions"; `unit`, `doc`.
    - `read(simulation, into)`: its current value in `into`, or in a new host array if that is None; a number if `rows` is
      "one". None: it is not readable.
    - `check(scene, array, real)`: an array of a state in the arithmetic `real`, its values unchanged. Raises InputError.
    - `download(simulation)`: what the next step reads, as a new host array; None where the scene has none.
    - `upload(simulation, array)`: continue from it; None: from its value in the uploaded state. Called after positions and
      velocities were uploaded, in the order of the fields.
    - `fault`: True for a count that must be 0, or else the run is incomplete.

    The last three functions belong to arrays of the state; `State` has an attribute of the same name
    (model/core/state.py).
    """

    name: str
    rows: str
    shape: tuple[int | str, ...]
    unit: str
    doc: str
    read: Read | None = None
    check: Callable[[Scene, object, Real], np.ndarray] | None = None
    download: Callable[[Any], np.ndarray | None] | None = None
    upload: Callable[[Any, np.ndarray | None], None] | None = None
    fault: bool = False

    @property
    def is_state(self) -> bool:
        """True if it is an array of the state."""
        return self.upload is not None


def written(result: object, into: Any) -> Any:
    """Return `into` with the values of `result`; `result` itself if `into` is None."""
    if into is None:
        return result
    into[...] = result
    return into


def on_host(compute: Callable[[Any], object]) -> Read:
    """Return the `read` of a field that `compute(simulation)` returns as a new host array, or as a number."""
    return lambda simulation, into: written(compute(simulation), into)


def counter(name: str, doc: str, count: Callable[[Any], float]) -> Field:
    """Return the field of a number of a run, `count(simulation)`."""
    return Field(name, "one", (), "1", doc, on_host(count))


def fault(name: str, doc: str, count: Callable[[Any], int]) -> Field:
    """Return the field of a count that must be 0. `count(simulation)` may include counts from before the simulation was
    open, because compiling may put all particles at one position (`lost_when_opened`)."""
    since_opened = on_host(lambda simulation: count(simulation) - simulation.lost_when_opened.get(name, 0))
    return Field(name, "one", (), "1", doc, since_opened, fault=True)


POSITION = Field(
    "position", "particles", ("dimensions",), "m", "positions", lambda simulation, into: simulation._read_position(into)
)
VELOCITY = Field(
    "velocity", "particles", ("dimensions",), "m/s", "velocities", on_host(lambda simulation: simulation._download()[1])
)
STRAIN = Field(
    "strain", "springs", (), "1", "length over rest length - 1 of springs; of each of the tetrahedra; density over rest "
    "density - 1 of each particle of fluids", on_host(lambda simulation: simulation._read_strain())
)  # fmt: skip
NORMAL = Field(
    "normal",
    "particles",
    (3,),
    "1",
    "unit normals of a surface",
    lambda simulation, into: simulation._read_normal(into),
)
CONTACTS_LOST = fault(
    "contacts_lost", "contacts, and vertices in the search distance, for which a search had no capacity",
    lambda simulation: surface_contacts_lost(simulation),
)  # fmt: skip
OF_ALL = (POSITION, VELOCITY)


def surface_contacts_lost(simulation: Any) -> int:
    """Return the contacts and neighbours of surfaces that did not fit, since the start."""
    contacts = simulation.contacts
    return 0 if contacts is None else int(contacts.lost) + int(getattr(contacts, "neighbours_lost", 0))


def of_springs(scene: Scene) -> tuple[Field, ...]:
    """Return the fields of grids, cloths and meshes."""
    normal = (NORMAL,) if scene.dimensions == 3 else ()
    has_contacts = scene.self_collision is not None or scene.contact is not None
    return (STRAIN, *normal, *((CONTACTS_LOST,) if has_contacts else ()))


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
    - `scheme_note(scene)`: limits of its scheme in this scene, or "".
    - `warnings(scene)`: lines on errors of the scene's settings, and on settings that help.
    - `stored(scene, position, arrays)`: the energy [J] in springs or clusters, and of a cloth's springs also by kind.
      `arrays`: those of the state that `fields` declares, by name.
    - `strain(scene, position, kind, arrays)`: the result of read("strain"), (springs,) or (entries,).
    - `spring_count(scene)`: the number of springs or their substitutes.
    - `fields(scene)`: its values by name, besides positions and velocities (`Field`).
    - `solvers`, `passes`: by backend, the class that it opens and the function that describes its passes for `softlab
      plan`, as
      `module:name`, since both are in layers above the model.
    - `clusters`: by backend, the class that the solver of position-based sheets iterates in place of constraints, in
      the same way.
    - `presentation`: how its scenes are drawn and described (app/presentation.py), in the same way.
    - `reference`: the module in bench/reference/ whose `simulate` computes its reference.
    - `unknown`: why there is no converged reference of the motion, and a substitute; None: one is known.
    - `stencil(scene)`: how far a step reads along the rows of its sheet, for sharing by rows (model/domains).
    - `apart(scene)`: the bodies of a scene in which none acts on another, for sharing by bodies
      (model/core/sharing/bodies.py).
    - `halo(scene)`: how far a substep reads [m], for sharing by slabs of space (model/domains/slabs.py).
    - `partitions(scene)`: the meshes of a scene, for sharing by parts of bodies (model/core/sharing/partitions.py).

    The last four raise SceneError for a part that prevents sharing; None: not yet supported for the family.
    """

    name: str
    accepts: Callable[[Scene], bool]
    knows: frozenset[str]
    plan: Callable[[Scene, frozenset[str]], Plan]
    record: Callable[[Scene, Real, tuple[float, ...], Clock], np.ndarray]
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
    fields: Callable[[Scene], tuple[Field, ...]] = of_springs
    scheme_note: Callable[[Scene], str] = lambda scene: ""
    warnings: Callable[[Scene], list[str]] = lambda scene: []
    unknown: str | None = None
    stencil: Callable[[Scene], Stencil] | None = None
    apart: Callable[[Scene], Apart] | None = None
    halo: Callable[[Scene], float] | None = None
    partitions: Callable[[Scene], SharedMesh] | None = None


ANY_SHEET = frozenset(
    {"damping", "gravity", "external", "perturbation", "method", RELEASE}
)  # every sheet supports them
