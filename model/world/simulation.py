"""A world on any backend: its members, each a simulation of its own, driven stage by stage, and what is asked of all of them
together: states, energies, pokes, live changes."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Protocol

import numpy as np

from model.core.clock import Clock
from model.core.errors import InputError
from model.core.plan import StageRun
from model.core.simulation import Options, Simulation
from model.core.state import State, checked_arrays
from model.scene.scene import Scene
from model.world.plan import name_of_stage
from model.world.wetting import checked_wetness

STAGES = "stages"


class Wetting(Protocol):
    """What a backend has of a cloth that drinks (model/world/plan.py, `soak`); `vertices` (n,): those of the cloth whose
    wetness it is."""

    vertices: np.ndarray

    def change(self, scene: Scene) -> None:
        """Rates of a scene whose numbers have changed."""

    def keep(self) -> None:
        """Put the wetness aside."""

    def restore(self) -> None:
        """As it was put aside."""

    def tell(self) -> np.ndarray:
        """(n,): the wetness now."""

    def take(self, wetness: np.ndarray) -> None:
        """Go on from (n,) others."""


class WorldSimulation(Simulation):
    """See model/core/simulation.py for the contract. `members`: the simulations by name, in the order of their particles, of
    which `slices` tells where they are.

    Members run their own plans stage by stage, through `stages`; nobody else steps them. A backend opens them (`_open`), and
    adds what runs between them (`_cross_stages`).
    """

    members: dict[str, Simulation]
    wetting: Wetting | None = None  # of a cloth that drinks

    def __init__(self, scene: Scene, options: Options):
        self.members, self.slices = {}, scene.world_set.slices()
        super().__init__(scene, options)

    def _open_members(self, kernel: str) -> None:
        """Each under such a kernel."""
        own = replace(self.options, kernel=kernel)
        for name, scene in self.scene.members.items():
            self.members[name] = self._open(scene, own)

    @abstractmethod
    def _open(self, scene: Scene, options: Options) -> Simulation:
        """A member's simulation."""

    @abstractmethod
    def _cross_stages(self) -> dict[str, StageRun]:
        """What runs the stages of the plan that are no member's."""

    def _all_stages(self) -> dict[str, StageRun]:
        """What runs each stage of the plan."""
        own = {
            name_of_stage(name, stage): run
            for name, member in self.members.items()
            for stage, run in member.stages.items()
        }
        return own | self._cross_stages()

    # ------------------------------------------------------------------ a step

    def _run(self, steps: int) -> None:
        self._executor.run(self.step, steps)

    def _keep(self) -> None:
        for member in self.members.values():
            member._keep()
        if self.wetting:
            self.wetting.keep()

    def _restore(self) -> None:
        for member in self.members.values():
            member._restore()
        if self.wetting:
            self.wetting.restore()

    def _first_diverged(self) -> int:
        for name, member in self.members.items():
            bad = member._first_diverged()
            if bad >= 0:
                return self.slices[name].start + bad
        return -1

    # ------------------------------------------------------------------ what may change

    def _parameters_changed(self) -> None:
        for name, member in self.members.items():
            place, particle = self.slices[name], self._poke_particle
            own = particle - place.start if place.start <= particle < place.stop else -1
            member.follow(self.scene.members[name], own, self._poke_force, self._clock)
        if self.wetting:
            self.wetting.change(self.scene)

    def _set_clock(self, clock: Clock) -> None:
        if clock != self._clock:
            self._clock = clock
            self._parameters_changed()

    # ------------------------------------------------------------------ the state

    def load(self, state: State) -> None:
        """See Simulation. Each member loads what is its own; `rotation` and `plastic` are those of bodies."""
        arrays, inverse_mass = checked_arrays(state, self.body.position.shape, self.options.precision)
        for name, member in self.members.items():
            place = self.slices[name]
            clusters = (state.rotation, state.plastic) if name == "bodies" else (None, None)
            member.load(
                State(
                    arrays["position"][place], arrays["velocity"][place], inverse_mass[place], state.time, state.step,
                    *clusters, state.clock,
                )
            )  # fmt: skip
        if self.wetting:
            place = self.slices["cloth"]
            self.wetting.take(checked_wetness(self.scene, state.wetness)[place][self.wetting.vertices])
        elif state.wetness is not None:
            raise InputError("the state has a wetness, and the scene has no [wetting]")
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

    def _download_wetness(self) -> np.ndarray | None:
        if not self.wetting:
            return None
        found = np.zeros(len(self.body.position), self.real)
        found[self.slices["cloth"]][self.wetting.vertices] = self.wetting.tell()
        return found

    def _bodies(self) -> Simulation | None:
        return self.members.get("bodies")

    def _cluster_count(self) -> int:
        member = self._bodies()
        return member._cluster_count() if member else 0

    def _download_rotation(self) -> np.ndarray | None:
        member = self._bodies()
        return member._download_rotation() if member else None

    def _download_plastic(self) -> np.ndarray | None:
        member = self._bodies()
        return member._download_plastic() if member else None

    # ------------------------------------------------------------------ the rest of the contract

    @property
    def contacts_lost(self) -> int:
        """Of particles of bodies, neighbours that there was no room for since the start."""
        return sum(getattr(member, "contacts_lost", 0) for member in self.members.values())

    def synchronize(self) -> None:
        """Wait for all members."""
        for member in self.members.values():
            member.synchronize()

    def close(self) -> None:
        """And all members."""
        super().close()
        self.__dict__.pop("_executor", None)
        for member in self.members.values():
            member.close()
