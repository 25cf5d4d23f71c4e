"""A world on any backend: its members, each a simulation of its own, driven stage by stage, and the methods that
involve all of them: states, energies, pokes, live changes."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from softlab.model.base.clock import Clock
from softlab.model.base.errors import InputError
from softlab.model.core.family import Field
from softlab.model.core.plan import StageRun
from softlab.model.core.simulation import Options, Simulation
from softlab.model.core.state import State, checked_arrays, checked_family_arrays
from softlab.model.scene.scene import Scene
from softlab.model.world.plan import BEGIN, FIND, GIVE, PROJECT, TAKE, name_of_stage

STAGES = "stages"


class WorldSimulation(Simulation):
    """A simulation of several members; see model/core/simulation.py for its methods.

    `members`: the simulations by name, in the order of their particles; `slices`: their particles. Members run their
    own plans stage by stage, through `stages`, and only the world steps them. A backend opens them (`_open`), and, if
    surfaces of members meet, their particles (`joined`) and the contacts between them (`contacts`).
    """

    members: dict[str, Simulation]
    joined: Any = None
    contacts: Any = None

    def __init__(self, scene: Scene, options: Options):
        self.members, self.slices = {}, scene.world_set.slices()
        super().__init__(scene, options)

    def _open_members(self, kernel: str) -> None:
        """Open each member with this kernel."""
        options = replace(self.options, kernel=kernel)
        for name, scene in self.scene.members.items():
            self.members[name] = self._open(scene, options)

    @abstractmethod
    def _open(self, scene: Scene, options: Options) -> Simulation:
        """Return a member's simulation."""

    def _all_stages(self) -> dict[str, StageRun]:
        """Return the functions that run each stage of the plan."""
        stages = {
            name_of_stage(name, stage): run
            for name, member in self.members.items()
            for stage, run in member.stages.items()
        }
        joined, contacts = self.joined, self.contacts
        if joined is None:
            return stages
        return stages | {
            BEGIN: lambda moment: joined.take(True),
            FIND: lambda moment: contacts.find(joined.before, joined.position),
            TAKE: lambda moment: joined.take(False),
            PROJECT: lambda moment: contacts.project(joined.before, joined.position),
            GIVE: lambda moment: joined.give(),
        }

    # ------------------------------------------------------------------ a step

    def _run(self, steps: int) -> None:
        self._executor.run(self.step, steps)

    def _store_snapshot(self) -> None:
        for member in self.members.values():
            member._store_snapshot()

    def _restore(self) -> None:
        for member in self.members.values():
            member._restore()

    def _first_diverged(self) -> int:
        for name, member in self.members.items():
            bad = member._first_diverged()
            if bad >= 0:
                return self.slices[name].start + bad
        return -1

    # ------------------------------------------------------------------ live changes

    def _parameters_changed(self) -> None:
        for name, member in self.members.items():
            place, particle = self.slices[name], self._poke_particle
            poked = particle - place.start if place.start <= particle < place.stop else -1
            member.follow(self.scene.members[name], poked, self._poke_force, self._clock)
        if self.contacts:
            self.contacts.change(self.scene)

    def _set_clock(self, clock: Clock) -> None:
        if clock != self._clock:
            self._clock = clock
            self._parameters_changed()

    # ------------------------------------------------------------------ the state

    def load(self, state: State) -> None:
        """Continue from a state, as Simulation.load; each member loads its particles."""
        arrays, inverse_mass = checked_arrays(state, self.body.position.shape, self.options.precision)
        time = float(state.time)
        if not np.allclose(inverse_mass, self._body_at(time).inverse_mass, rtol=1e-6, atol=0):
            raise InputError("inverse_mass differs from the scene's; give the scene the same masses and pins")
        others = checked_family_arrays(state, self.state_fields)
        self._enter(time)
        for name, member in self.members.items():
            place = self.slices[name]
            of_member = {field.name: others.get(field.name) for field, _ in member.state_fields}
            member.load(
                State(
                    arrays["position"][place], arrays["velocity"][place], inverse_mass[place], state.time, state.step,
                    clock=state.clock, **of_member,
                )
            )  # fmt: skip
        first = next(iter(self.members.values()))
        self._set_clock(first._clock)
        self.step, self.time = first.step, first.time
        self._put_aside()

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        each = [member._download() for member in self.members.values()]
        position, velocity = (np.concatenate(arrays) for arrays in zip(*each, strict=True))
        return position, velocity

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        for name, member in self.members.items():
            member._upload(position[self.slices[name]], velocity[self.slices[name]])

    @cached_property
    def state_fields(self) -> Sequence[tuple[Field, Simulation]]:
        """The arrays of all members."""
        return [pair for member in self.members.values() for pair in member.state_fields]

    # ------------------------------------------------------------------ other methods of Simulation

    def synchronize(self) -> None:
        """Wait for all members."""
        for member in self.members.values():
            member.synchronize()

    def close(self) -> None:
        """Close this and all members."""
        super().close()
        self.__dict__.pop("_executor", None)
        for member in self.members.values():
            member.close()
