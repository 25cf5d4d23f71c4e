"""The part of a simulation that is the same for every backend: states in and out, reads, live parameters.

model/core/stepping.py counts steps and finds the first bad one; a backend adds the methods of model/core/backend.py;
app/driver.py opens one class per backend and solver. The state stays on the backend's device; nothing is allocated in
`advance`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from softlab.model.base.clock import START, Clock, clock_of
from softlab.model.base.errors import Diverged, InputError, SceneError
from softlab.model.core.build import Body, build
from softlab.model.core.energy import energies
from softlab.model.core.families import family_of, stability_limit
from softlab.model.core.family import OF_ALL, Field
from softlab.model.core.options import PRECISIONS, Options, check_live
from softlab.model.core.plan import Executor, Plan, StageRun
from softlab.model.core.stability.divergence import DIVERGED_SIZE, check_interval
from softlab.model.core.state import State, checked_arrays, checked_family_arrays
from softlab.model.core.stepping import Stepping
from softlab.model.scene.scene import Scene

NO_BODIES = "needs bodies of clusters; this scene has none"
STILL = (0.0, 0.0, 0.0)  # m/s


class Simulation(Stepping):
    """One scene under one solver on one backend, a context manager.

    Public attributes: `scene`, `body` (its arrays at time 0), `options`, `real` (numpy type of the precision), `plan`,
    `backend` ("cpu" or "gpu"), `device` (the processor's name), `threads` (CPU threads, or GPU threads per block),
    `kernel` (the kernel's name), `step`, `time` [s], `limit` (largest stable dt [s]), `check_interval` (steps), `snapshots`
    (number of snapshots so far).
    """

    backend: str
    device: str
    threads: int
    kernel: str
    plan: Plan
    _executor: Executor

    members: Mapping[str, Simulation] = MappingProxyType({})  # of a world, by name
    steps_together = 1  # steps of a kernel in one pass over memory
    threads_reason: str | None = None  # reason for the number of threads, where `auto` chose it
    lost_when_opened: Mapping[str, int] = MappingProxyType({})  # counts of faults (`fault` in model/core/family.py)

    def __init__(self, scene: Scene, options: Options):
        self.scene = scene
        self.options = options
        self.real = PRECISIONS[options.precision]
        self.body: Body = options.body or build(scene)
        self._first_body = self.body  # `self.body` has the currently inactive bodies
        self.step = 0
        self.time = 0.0
        self.limit = stability_limit(scene)
        self.check_interval = check_interval(len(self.body.position), self.backend)
        largest = 1e38 if options.precision == "float32" else 1e307  # still distinguishable from infinity
        self._bound, self._centre = min(DIVERGED_SIZE * self.body.size, largest), self.body.centre
        self._poke_particle = -1
        self._poke_force = (0.0,) * scene.dimensions
        self._clock = START
        self._record = self._make_record(scene, self._poke_force, self._clock)
        self._snapshot_step, self._snapshot_time = 0, 0.0
        self.snapshots = 0

    @cached_property
    def fields(self) -> Mapping[str, Field]:
        """The values of its scene by name: outputs, counters, arrays of the state."""
        return {field.name: field for field in (*OF_ALL, *family_of(self.scene).fields(self.scene))}

    @property
    def outputs(self) -> Mapping[str, Field]:
        """Outputs that `read` returns, by name."""
        return {name: field for name, field in self.fields.items() if field.read}

    @cached_property
    def state_fields(self) -> Sequence[tuple[Field, Simulation]]:
        """Arrays of the state besides positions and velocities, and the simulation that has each."""
        return [(field, self) for field in self.fields.values() if field.is_state]

    def counters(self) -> dict[str, float]:
        """Return the numbers of the run, by name (`Field`), those of `faults` included."""
        return {name: self.read(name) for name, field in self.fields.items() if field.rows == "one"}

    def faults(self) -> dict[str, int]:
        """Return the counts, since opening, of entries that did not fit into lists of fixed length; {} without
        contacts."""
        return {name: self.read(name) for name, field in self.fields.items() if field.fault}

    @property
    def stages(self) -> Mapping[str, StageRun]:
        """Functions that run single stages of the plan, by name; only with the kernel `stages`."""
        return self._executor.stages

    def warm_up(self, steps: int = 1) -> None:
        """Compile, and on a GPU capture, the kernels for `steps` steps, and keep the state. Otherwise the first
        `advance` includes compiling, which takes up to a minute.

        Otherwise the first `advance` includes compiling, which takes up to a minute.

        Parameters
        ----------
        steps : int
            Steps of the later calls of `advance`.
        """
        start = self.state()
        with suppress(Diverged):  # the run itself will detect and report it
            self.advance(steps)
            self.check()
        self._run_released(start.time, steps)
        self.load(start)

    def _make_record(self, scene: Scene, poke: Sequence[float], clock: Clock) -> np.ndarray:
        """Return the record of constants that the kernels read, (1,)."""
        return family_of(scene).record(scene, self.real, tuple(poke), clock)

    # ------------------------------------------------------------------ what a user calls

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def state(self) -> State:
        """Copy the state to the host.

        Returns
        -------
        State

        Raises
        ------
        Diverged
            The state is not finite.
        """
        self.require_open()
        self.check()
        position, velocity = self._download()
        self._note_active(position)
        inverse_mass = self.body.inverse_mass.copy()
        arrays = {field.name: one._download_field(field) for field, one in self.state_fields}
        return State(position, velocity, inverse_mass, self.time, self.step, clock=self._clock, **arrays)

    def load(self, state: State) -> None:
        """Continue from a state: bit for bit, if it is of this scene in the same precision and `exact` math.

        Parameters
        ----------
        state : State

        Raises
        ------
        InputError
            Arrays have another shape, values are not finite, pins differ from the scene's, rotations are not unit
            quaternions, or plastic deformations do not have determinant 1 or belong to another scene.
        """
        self.require_open()
        arrays, inverse_mass = checked_arrays(state, self.body.position.shape, self.options.precision)
        self._take_masses(arrays["position"], inverse_mass, float(state.time))
        others = checked_family_arrays(state, self.state_fields)
        self._enter(float(state.time))
        self._set_clock(clock_of(state.clock, int(state.step), float(state.time), self.scene.method.dt))
        if len(self.body.pinned):
            arrays["velocity"] = arrays["velocity"].copy()  # the array may be the caller's
            arrays["velocity"][self.body.pinned] = self._pin_velocity(int(state.step))
        self._upload(arrays["position"], arrays["velocity"])
        for field, one in self.state_fields:
            one._upload_field(field, others.get(field.name))
        self.step, self.time = int(state.step), self._clock.at(int(state.step), self.scene.method.dt)
        self._put_aside()

    def _set_clock(self, clock: Clock) -> None:
        """Set the clock, if it differs."""
        if clock != self._clock:
            self._clock, self._record = clock, self._make_record(self.scene, self._poke_force, clock)
            self._parameters_changed()

    def follow(self, scene: Scene, particle: int, force: Sequence[float], clock: Clock) -> None:
        """Take over, from the next step on, the changes of a world of which this is a member.

        `scene`: the member's; `particle`: the poked one (-1: none); `force`: on it [N]; `clock`: the world's.
        """
        self.scene, self._clock, self.limit = scene, clock, stability_limit(scene)
        self._poke_particle, self._poke_force = particle, tuple(force)
        self._record = self._make_record(scene, force, clock)
        self._parameters_changed()

    def _note_active(self, position: np.ndarray) -> None:
        """Set the inverse masses of `body` from downloaded positions, in families that mark inactive particles by them."""

    def _take_masses(self, position: np.ndarray, inverse_mass: np.ndarray, time: float) -> None:
        """Take the inverse masses of a state at `time` [s]. Raises InputError where they are not possible."""
        if not self._are_masses_at(inverse_mass, time):
            raise InputError("inverse_mass differs from the scene's; give the scene the same masses and pins")

    def _are_masses_at(self, inverse_mass: np.ndarray, time: float) -> bool:
        """Return True for the scene's inverse masses at `time` [s]. As on every reset the array itself is compared first:
        comparing millions of numbers takes a while."""
        known = self._body_at(time).inverse_mass
        return inverse_mass is known or np.allclose(inverse_mass, known, rtol=1e-6, atol=0)

    def reset(self) -> None:
        """Return to the scene's start."""
        self._enter(0.0)
        body = self._first_body
        self.load(State(body.position, body.velocity, body.inverse_mass, 0.0, 0))

    def add_body(self, name: str, origin: Sequence[float] | None = None, velocity: Sequence[float] = STILL) -> int:
        """Activate a spare copy of a body.

        Parameters
        ----------
        name : str
            Body of the scene with spare copies.
        origin : (3,) sequence of float, optional
            Where to put the origin of its mesh, m; by default where the scene has it.
        velocity : (3,) sequence of float
            Its velocity, m/s.

        Returns
        -------
        int
            Number of the copy, in `scene.body_set.copies`.

        Raises
        ------
        SceneError
            There is no such body, or no spare copy is left.
        """
        raise SceneError("body", name, NO_BODIES)

    def remove_body(self, number: int) -> None:
        """Deactivate a copy of a body, which is a spare one from now on.

        Parameters
        ----------
        number : int
            Number of the copy.

        Raises
        ------
        SceneError
            There is no such copy, it is inactive already, or the scene has no spare copies.
        """
        raise SceneError("body", number, NO_BODIES)

    def read(self, name: str, into: object = None) -> Any:
        """Read an output, which is computed on request. Does not check for divergence.

        Parameters
        ----------
        name : str
            `position` or `velocity` : (particles, dimensions), m or m/s.
            `strain` : (springs,); of fluids (particles,), density over rest density minus 1.
            `normal` : (particles, 3), unit normals of a cloth.
            `rotation` : (clusters, 4), unit quaternions (w, x, y, z) of bodies.
            `centre` : (clusters, 3), m, centres of mass of bodies' clusters.
            `deformation` : (clusters, 3, 3), the matrix from rest offsets to goal offsets.
            `plastic` : (clusters, 3, 3), as in State.
            `pressure` : (particles,), Pa, of fluids.
            `contacts_lost`, `neighbours_lost` : a number, what did not fit into lists, which makes a run incomplete.
            `speed_limited`, `not_emitted` : a number of particles that the speed limit slowed; that had no room.
            `matrices`, `newton_steps`, `matrix_products` : numbers per solve by Newton's method.
        into : array, optional
            Where to write: a host array, or on a GPU for position and normal anything with `__cuda_array_interface__`.

        Returns
        -------
        array
            `into`, or a new host array.

        Raises
        ------
        SceneError
            The scene has no such output.
        """
        self.require_open()
        field = self.fields.get(name)
        if field is None or field.read is None:
            raise SceneError("read", name, f"must be one of {', '.join(self.outputs)}")
        return self._read_field(field, into)

    def _read_field(self, field: Field, into: object) -> Any:
        """Read a field that is readable; see `Field`, as for the two methods below."""
        assert field.read is not None
        return field.read(self, into)

    def _download_field(self, field: Field) -> np.ndarray | None:
        assert field.download is not None
        return field.download(self)

    def _upload_field(self, field: Field, array: np.ndarray | None) -> None:
        assert field.upload is not None
        field.upload(self, array)

    def read_clusters(self) -> tuple[np.ndarray, np.ndarray]:
        """Read rotations and centres of all clusters of bodies at the same instant.

        Returns
        -------
        rotation : (clusters, 4) float array
            Unit quaternions (w, x, y, z).
        centre : (clusters, 3) float array, m

        Raises
        ------
        SceneError
            The scene has no bodies.
        """
        raise SceneError("read", "clusters", NO_BODIES)

    def set(self, path: str, value: object) -> None:
        """Change a live field from the next step on.

        Parameters
        ----------
        path : str
            Dotted path: `gravity.enabled`, `method.dt`, ...
        value : object
            New value.

        Raises
        ------
        SceneError
            The scene refuses the value, or `live` did not name the field when the simulation was opened.
        """
        self.require_open()
        check_live(self.scene, self.options.live, path, value)
        scene = self.scene.replace({path: value}).at(self.time)
        clock = self._clock if scene.method.dt == self.scene.method.dt else Clock(self.step, self.time)
        record = self._make_record(scene, self._poke_force, clock)
        self.check()  # so that a replay never spans a change
        self._before_change()
        self.scene, self._record, self._clock = scene, record, clock
        self.limit = stability_limit(scene)
        self._snapshot_step, self._snapshot_time = self.step, self.time
        self._parameters_changed()

    def _before_change(self) -> None:
        """Prepare for another scene from the current step on, in families whose state refers to the present one."""

    def poke(self, particle: int | None, force: Sequence[float] = ()) -> None:
        """Apply a force to one particle until the next call. Needs `live` to name poke.

        Parameters
        ----------
        particle : int or None
            Number of the particle; None releases it.
        force : (dimensions,) sequence of float
            Force, N.
        """
        self.require_open()
        if "poke" not in self.options.live:
            raise SceneError("poke", particle, "not live; open the simulation with live including 'poke'")
        if particle is None:
            particle, force = -1, [0.0] * self.scene.dimensions
        elif not 0 <= particle < len(self.body.position):
            raise SceneError("poke", particle, f"must be a particle, 0 to {len(self.body.position) - 1}")
        if len(force) != self.scene.dimensions or not np.isfinite(force).all():
            raise SceneError("poke", force, f"must be {self.scene.dimensions} finite numbers")
        self._apply_poke(particle, tuple(force))

    def _apply_poke(self, particle: int, force: tuple[float, ...]) -> None:
        record = self._make_record(self.scene, force, self._clock)
        self.check()
        self._poke_particle, self._poke_force, self._record = particle, force, record
        self._parameters_changed()

    def energies(self) -> dict[str, float]:
        """Compute energies in float64 on the host (model/core/energy.py).

        Returns
        -------
        dict of str to float
            Kinetic, spring and gravitational energy, their sum, and `conserved`: what the scheme itself conserves, J.

        Raises
        ------
        Diverged
            The state is not finite.
        """
        state = self.state()
        return energies(self.scene, state.position, state.velocity, state.arrays, state.inverse_mass)
