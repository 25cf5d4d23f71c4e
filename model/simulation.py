"""The contract a backend fulfils: one class per backend and solver, opened by app/driver.py.

`Simulation` holds what is the same for every backend: the step counter, live parameters, and the hunt for the first bad
step. A backend adds the five methods under "what a backend writes". The state stays on the backend's device; nothing
is allocated in `advance`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isqrt
from typing import Any

import numpy as np

from model import spare
from model.build import Body, build
from model.cloth_parts import SPRING_KINDS
from model.cloth_record import cloth_record
from model.cluster_tables import checked_plastic, checked_rotation
from model.diagnosis import diagnose
from model.errors import Diverged, InputError, SceneError
from model.integrators import stability_limit
from model.plan import Executor, Plan
from model.record import parameter_record
from model.scene import Scene
from model.xpbd_record import xpbd_record

PRECISIONS = {"float32": np.float32, "float64": np.float64}
MATHS = ("fast", "exact")
# Steps between two looks for a diverged state. A look takes 0.01 ms of a small grid on a CPU, 0.4 ms (its launches and
# copies) on a GPU; it is to cost under 1 % (measured by bench/findings_costs.py). So the interval is a number of
# mass-steps, which a GPU does in a small part of a CPU's time; small grids, whose steps take less than a microsecond,
# have a largest one.
LEAST_INTERVAL = 1024
MOST_INTERVAL = {"cpu": 2**15, "gpu": 2**19}
INTERVAL_WORK = {"cpu": 2**28, "gpu": 2**35}  # mass-steps
DIVERGED_SIZE = 1e6  # times the scene's size: a coordinate beyond it counts as diverged

LIVE_PATHS = {  # what may be named in `live=`, and the stage that then is compiled in even if it starts switched off
    "gravity": ("gravity.enabled", "gravity.acceleration"),
    "poke": (),
    "dt": ("method.dt",),
    "stiffness": ("springs.stiffness", *(f"{kind}.stiffness" for kind in SPRING_KINDS)),
    "damping": ("damping.coefficient",),
    "wind": ("wind.velocity", "wind.density", "wind.drag", "wind.lift"),
}


def check_interval(particle_count: int, backend: str) -> int:
    """Steps between two looks for a diverged state: so many that looking costs under 1 %, whatever the size."""
    return max(LEAST_INTERVAL, min(MOST_INTERVAL[backend], INTERVAL_WORK[backend] // max(1, particle_count)))


@dataclass(frozen=True)
class State:
    """Every array the next step reads. `position`, `velocity` (particles, dimensions), C-contiguous, in builder order, in
    the simulation's precision; `inverse_mass` (particles,) [1/kg], 0 where pinned; `time` [s]; `step`; of bodies
    `rotation` (clusters, 4), the unit quaternions (w, x, y, z) that the next rotations are looked for from: None where there
    are none, or they are to be found anew; of plastic bodies `plastic` (clusters, 3, 3), of volume 1: what their rest offsets
    have been bent by, None: nothing."""

    position: np.ndarray
    velocity: np.ndarray
    inverse_mass: np.ndarray
    time: float
    step: int
    rotation: np.ndarray | None = None
    plastic: np.ndarray | None = None


@dataclass(frozen=True)
class Options:
    """How a scene is run, apart from what it is. `kernel` None: the backend's own choice."""

    precision: str = "float32"
    math: str = "fast"
    kernel: str | None = None
    live: frozenset[str] = field(default_factory=frozenset)

    def __post_init__(self) -> None:
        for name, value, known in (("--precision", self.precision, tuple(PRECISIONS)), ("--math", self.math, MATHS)):
            if value not in known:
                raise SceneError(name, value, f"must be one of {', '.join(known)}")
        for name in self.live:
            if name not in LIVE_PATHS:
                raise SceneError("live", name, f"must be of {', '.join(LIVE_PATHS)}")


class Simulation(ABC):
    """One world under one solver on one backend, a context manager.

    Public attributes: `scene`, `body` (its arrays at time 0), `options`, `real` (numpy type of the precision), `plan`,
    `backend` ("cpu" or "gpu"), `device` (the processor's name), `threads` (CPU threads, or GPU threads a block),
    `kernel` (which kernel runs), `step`, `time` [s], `limit` (largest stable dt [s]), `check_interval` (steps),
    `kept` (how many states were put aside so far).
    """

    backend: str
    device: str
    threads: int
    kernel: str
    plan: Plan
    _executor: Executor

    def __init__(self, scene: Scene, options: Options):
        self.scene = scene
        self.options = options
        self.real: Any = PRECISIONS[options.precision]
        self.body: Body = build(scene)
        self._first_body = self.body  # `self.body` tells which bodies wait now
        self.step = 0
        self.time = 0.0
        self.limit = stability_limit(scene)
        self.check_interval = check_interval(len(self.body.position), self.backend)
        largest = 1e38 if options.precision == "float32" else 1e307  # what the arithmetic can still tell from infinity
        self._bound = min(DIVERGED_SIZE * self.body.size, largest)
        self._poke_particle = -1
        self._poke_force = (0.0,) * scene.dimensions
        self._record = self._make_record(scene, self._poke_force)
        self._kept_step, self._kept_time = 0, 0.0
        self.kept = 0

    # ------------------------------------------------------------------ what a backend writes

    @abstractmethod
    def _run(self, steps: int) -> None:
        """Advance the state by `steps` (>= 1) steps from `self.step`, using the current parameter record."""

    @abstractmethod
    def _keep(self) -> None:
        """Copy the state aside, on the device."""

    @abstractmethod
    def _restore(self) -> None:
        """Take the state put aside by `_keep` back."""

    @abstractmethod
    def _first_bad(self) -> int:
        """The lowest index of a particle with a non-finite value or a coordinate beyond `self._bound`, or -1."""

    @abstractmethod
    def _parameters_changed(self) -> None:
        """Send `self._record` and the poke to the device."""

    @abstractmethod
    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        """(position, velocity) as new host arrays (particles, dimensions) in the simulation's precision."""

    @abstractmethod
    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Take (particles, dimensions) arrays in the simulation's precision as the state."""

    def _read_position(self, into: Any) -> Any:
        """Position into `into` (None: a new host array). A backend with a device overrides this for device targets."""
        position, _ = self._download()
        if into is None:
            return position
        into[...] = position
        return into

    def _read_normal(self, into: Any) -> Any:
        """A cloth's normals into `into` (None: a new host array, in the simulation's precision). Computed on the host in
        float64; a backend overrides this to compute them where the state is."""
        from model.normals import scene_normals

        normal = scene_normals(self.scene, self._read_position(None))
        if into is None:
            return normal.astype(self.real)
        into[...] = normal
        return into

    def _download_rotation(self) -> np.ndarray | None:
        """The clusters' rotations of the state, see State; None where a scene has no bodies."""
        return None

    def _upload_rotation(self, rotation: np.ndarray | None) -> None:  # noqa: B027 - most scenes have none
        """Take rotations, or find those of the state that was uploaded, from no rotation."""

    def _download_plastic(self) -> np.ndarray | None:
        """What clusters have been bent by, see State; None where a scene has no plastic bodies."""
        return None

    def _upload_plastic(self, plastic: np.ndarray | None) -> None:  # noqa: B027 - most scenes have none
        """Take it; None: no cluster is bent. Comes before `_upload_rotation`."""

    def _read_deformation(self) -> np.ndarray:
        """(clusters, 3, 3): what takes rest offsets to goals, with particles where they are now, as a new host array."""
        raise NotImplementedError

    def _read_clusters(self) -> tuple[np.ndarray, np.ndarray]:
        """(rotation (clusters, 4), centre of mass (clusters, 3) [m]) of bodies with particles where they are now, as new
        host arrays; the state stays as it is."""
        raise NotImplementedError

    @abstractmethod
    def synchronize(self) -> None:
        """Return when every step asked for has been done."""

    def close(self) -> None:  # noqa: B027 - nothing to free is a valid answer
        """Free what the simulation holds; nothing else may be called after it."""

    @property
    def stages(self) -> Mapping[str, Callable[[int, float], None]]:
        """What runs each stage of the plan by itself, by name; of the kernel `stages` only."""
        return self._executor.stages

    def _make_record(self, scene: Scene, poke: Sequence[float]) -> np.ndarray:
        """The small record of constants that the kernels read."""
        make = cloth_record if scene.cloth else parameter_record
        if scene.method.position_based:
            make = xpbd_record
        return make(scene, self.real, tuple(poke))

    # ------------------------------------------------------------------ what a user calls

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def advance(self, steps: int) -> None:
        """Do `steps` steps of `method.dt` each. Raises Diverged (then the state is the last checked finite one).

        The state is looked at every `check_interval` steps, and whenever it is read; the interval in which it went bad is
        then replayed to name the first bad step and particle.
        """
        if steps < 0:
            raise SceneError("steps", steps, "must be at least 0")
        while steps > 0:
            batch = min(steps, self.check_interval - (self.step - self._kept_step))
            self._run(batch)
            self._count(batch)
            steps -= batch
            if self.step - self._kept_step >= self.check_interval:
                self.check()

    def _count(self, steps: int) -> None:
        self.step += steps
        self.time = self._kept_time + (self.step - self._kept_step) * self.scene.method.dt

    def check(self, keep: bool = True) -> None:
        """Look at the state now; raise Diverged if it is bad, else put it aside as the last good one (if `keep`)."""
        if self.step == self._kept_step:
            return
        if self._first_bad() < 0:
            if keep:
                self._put_aside()
            return
        last = self.step
        self.rewind()
        begin, _ = self._replay(last, isqrt(last - self.step))  # so that both ways together look the fewest times
        self.rewind()
        if begin > self.step:
            self._run(begin - self.step)
            self._count(begin - self.step)
        _, bad = self._replay(last, 1)
        step = self.step
        self.rewind()
        found = diagnose(self.scene, self.limit, self._download()[1])
        raise Diverged(step, bad, self.scene.method.dt, self.limit, found.cause, found.remedy)

    def _replay(self, last: int, interval: int) -> tuple[int, int]:
        """Go on to step `last` or the first look at a bad state: (step of the look before, the bad particle or -1)."""
        begin, bad = self.step, -1
        while bad < 0 and self.step < last:
            begin = self.step
            batch = min(interval, last - begin)
            self._run(batch)
            self._count(batch)
            bad = self._first_bad()
        return begin, bad

    def _put_aside(self) -> None:
        self._keep()
        self._kept_step, self._kept_time = self.step, self.time
        self.kept += 1

    def rewind(self) -> None:
        """Back to the state that was put aside last, without a copy through the host.

        That is the one loaded last, until `kept` moves on: a look at the state (`check`, `state`, and `advance` every
        `check_interval` steps) puts a newer one aside.
        """
        self._restore()
        self.step, self.time = self._kept_step, self._kept_time

    def state(self) -> State:
        """A copy of the state on the host. Raises Diverged rather than hand out a bad one."""
        self.check()
        position, velocity = self._download()
        inverse_mass = self.body.inverse_mass.copy()
        bodies = self._download_rotation(), self._download_plastic()
        return State(position, velocity, inverse_mass, self.time, self.step, *bodies)

    def load(self, state: State) -> None:
        """Continue from `state` (bit for bit, if it was this scene's in the same precision and `exact` math).

        Raises InputError for arrays of another shape, non-finite values, pins other than the scene's, rotations that are
        no unit quaternions, or plastic strains that are not of volume 1 or of a scene without.
        """
        count = len(self.body.position)
        arrays = {}
        for name in ("position", "velocity"):
            array = np.asarray(getattr(state, name))
            if array.shape != self.body.position.shape:
                raise InputError(f"{name} has shape {array.shape}, this scene needs {self.body.position.shape}")
            if not np.issubdtype(array.dtype, np.number) or np.issubdtype(array.dtype, np.complexfloating):
                raise InputError(f"{name} holds {array.dtype}, this needs real numbers")
            with np.errstate(over="ignore"):
                arrays[name] = np.ascontiguousarray(array, dtype=self.real)
            if not np.isfinite(arrays[name]).all():
                raise InputError(f"{name} holds values that are not finite numbers in {self.options.precision}")
        inverse_mass = np.asarray(state.inverse_mass)
        if inverse_mass.shape != (count,):
            raise InputError(f"inverse_mass has shape {inverse_mass.shape}, this scene needs ({count},)")
        same = inverse_mass is self.body.inverse_mass  # as on every reset: comparing millions takes a while
        if not same and not np.allclose(inverse_mass, self.body.inverse_mass, rtol=1e-6, atol=0):
            self._take_weights(inverse_mass)
        rotation = state.rotation
        if rotation is not None:
            rotation = checked_rotation(rotation, self._cluster_count(), self.real)
        plastic = state.plastic
        if plastic is not None:
            if "plastic" not in self.plan.parts:
                raise InputError("plastic: this scene has no plastic bodies; plastic_creep makes them so")
            plastic = checked_plastic(plastic, self._cluster_count(), self.real)
        if len(self.body.pinned):
            arrays["velocity"] = arrays["velocity"].copy()  # it may be the caller's
            arrays["velocity"][self.body.pinned] = self._pin_velocity(int(state.step))
        self._upload(arrays["position"], arrays["velocity"])
        self._upload_plastic(plastic)
        self._upload_rotation(rotation)
        self.step, self.time = int(state.step), float(state.time)
        self._put_aside()

    def _take_weights(self, inverse_mass: np.ndarray) -> None:
        """Other bodies wait than do now. Raises InputError where anything else is different."""
        waits = spare.waiting(self.scene, inverse_mass) if "spare" in self.plan.parts else None
        if waits is None:
            raise InputError("inverse_mass differs from the scene's; give the scene the same masses and pins")
        weights = np.where(waits, 0.0, 1 / self.scene.crowd.clusters.mass)
        self.body = replace(self.body, inverse_mass=weights, pinned=np.flatnonzero(waits))
        self._weights_changed()

    def _weights_changed(self) -> None:
        """Send `self.body.inverse_mass` to where the state is; the state itself is uploaded right after it."""
        raise NotImplementedError

    def _cluster_count(self) -> int:
        return self.scene.crowd.clusters.count if self.scene.bodies else 0

    def _pin_velocity(self, step: int) -> Any:
        """Of the pinned masses [m/s] when step `step` begins: 0, or what their motions say."""
        return 0

    def reset(self) -> None:
        """Back to the scene's start."""
        body = self._first_body
        self.load(State(body.position, body.velocity, body.inverse_mass, 0.0, 0))

    def add_body(
        self, name: str, origin: Sequence[float] | None = None, velocity: Sequence[float] = spare.STILL
    ) -> int:
        """Bring in a spare copy of the body `name`: its mesh's origin at `origin` (that of the part) [m], turned as the part
        says, moving at `velocity` [m/s]. The number of the copy (in `scene.crowd.copies`).

        Raises SceneError: no such body, or none left (its `spare` says how many there are).
        """
        found, state = spare.added(self, name, origin, velocity)
        self.load(state)
        return found

    def remove_body(self, number: int) -> None:
        """Take a copy out; it is a spare one from now on. Raises SceneError: no such copy, or it waits already, or the scene
        was made without spare ones."""
        self.load(spare.removed(self, number))

    def read(self, name: str, into: Any = None) -> Any:
        """`position`, `velocity` (particles, dimensions), `strain` (springs,) or, of a cloth, `normal` (particles, 3): the
        unit normals for drawing it; of bodies `rotation` (clusters, 4), unit quaternions (w, x, y, z), and `centre`
        (clusters, 3) [m], of mass, with particles where they are now, for skins; `deformation` (clusters, 3, 3): the
        rotation, or whatever else takes rest offsets to where a cluster wants them; of plastic ones `plastic`, as in State:
        what has bent their rest offsets. Each is computed only when asked.

        `into`: a host array, or (GPU, position and normal) anything with `__cuda_array_interface__`; None: a new host
        array. Does not check for divergence: it is what the window draws.
        """
        if name == "position":
            return self._read_position(into)
        if name == "normal":
            if not self.scene.cloth:
                raise SceneError("read", name, "must be one of position, velocity, strain: a grid lies in a plane")
            return self._read_normal(into)
        if name == "velocity":
            result = self._download()[1]
        elif self.scene.bodies and name in ("rotation", "centre"):
            result = self._read_clusters()[name == "centre"]
        elif self.scene.bodies and name == "deformation":
            result = self._read_deformation()
        elif name == "plastic" and "plastic" in self.plan.parts:
            result = np.asarray(self._download_plastic())
        elif self.scene.bodies:
            names = "position, velocity, rotation, centre, deformation"
            raise SceneError("read", name, f"must be one of {names}{', plastic' * ('plastic' in self.plan.parts)}")
        elif name == "strain":
            from model.energy import spring_strain

            result = spring_strain(self.scene, self._download()[0])
        else:
            names = "position, velocity, strain" + (", normal" if self.scene.cloth else "")
            raise SceneError("read", name, f"must be one of {names}")
        if into is None:
            return result
        into[...] = result
        return into

    def set(self, path: str, value: Any) -> None:
        """Change a live field (`gravity.enabled`, `method.dt`, ...) from the next step on.

        Raises SceneError for a value the scene refuses, or a field not named in `live` when the simulation was opened.
        """
        allowed: Iterable[str] = [p for name in self.options.live for p in LIVE_PATHS[name]]
        if path not in allowed:
            raise SceneError(path, value, f"not live; live here: {', '.join(sorted(allowed)) or 'nothing'}")
        part = path.partition(".")[0]
        if part in (*SPRING_KINDS, "wind") and part not in self.scene.parts:
            raise SceneError(path, value, "the scene has no such part, so no code for it was compiled")
        scene = self.scene.replace({path: value})
        record = self._make_record(scene, self._poke_force)
        self.check()  # so that a replay never spans a change
        self.scene, self._record = scene, record
        self.limit = stability_limit(scene)
        self._kept_step, self._kept_time = self.step, self.time
        self._parameters_changed()

    def poke(self, particle: int | None, force: Sequence[float] = ()) -> None:
        """Hold a force [N] on one particle until the next call; `poke(None)` lets go. Needs `live` to name poke."""
        if "poke" not in self.options.live:
            raise SceneError("poke", particle, "not live; open the simulation with live including 'poke'")
        if particle is None:
            particle, force = -1, [0.0] * self.scene.dimensions
        elif not 0 <= particle < len(self.body.position):
            raise SceneError("poke", particle, f"must be a particle, 0 to {len(self.body.position) - 1}")
        if len(force) != self.scene.dimensions or not np.isfinite(force).all():
            raise SceneError("poke", force, f"must be {self.scene.dimensions} finite numbers")
        record = self._make_record(self.scene, force)
        self.check()
        self._poke_particle, self._poke_force, self._record = particle, tuple(force), record
        self._parameters_changed()

    def energies(self) -> dict[str, float]:
        """Kinetic, spring and gravity energy [J] with the true mass, their sum, and the scheme's own `conserved`.

        See model/energy.py. float64 on the host. Raises Diverged.
        """
        from model.energy import energies

        state = self.state()
        return energies(self.scene, state.position, state.velocity, state.plastic, state.inverse_mass)
