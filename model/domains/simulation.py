"""A sheet that is stepped in windows: the contract of a simulation, kept by the windows together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any

import numpy as np

from model.core.build import rows_of
from model.core.errors import SceneError
from model.core.families import family_of, scene_plan
from model.core.options import Options
from model.core.own_forces import own_parts
from model.core.simulation import Simulation
from model.domains.decomposition import Decomposition, Domain, decompose
from model.domains.exchange import Exchange
from model.scene.scene import Scene

NOBODY = 2**62  # beyond any particle's number


def cut(scene: Scene, count: int, steps: int | None, option: str) -> Decomposition:
    """The scene's sheet in `count` domains. Raises SceneError where its family, or a part of it, cannot be cut yet."""
    family = family_of(scene)
    if family.reach is None:
        raise SceneError(
            option, count, f"shares sheets of springs or constraints alone so far, no {family.name}; use 1"
        )
    return decompose(scene.grid.rows, scene.grid.columns, count, family.reach(scene), steps, option)


def window_scene(scene: Scene, pinned: np.ndarray, domain: Domain, divided: int = 1) -> Scene:
    """The scene of a window; `pinned`: flat indices of the whole sheet's pinned masses. Where its masses begin is of no
    matter: its state is loaded, and its constants are the sheet's. Its step is one of `divided` parts of the sheet's."""
    columns, name = scene.grid.columns, scene.name_of("grid", "cloth", default="grid")
    first, end = domain.window_first * columns, domain.window_end * columns
    mine = pinned[(pinned >= first) & (pinned < end)] - first
    places = [(int(k) // columns, int(k) % columns) for k in mine]
    changes: dict[str, Any] = {f"{name}.rows": domain.window_rows, f"{name}.pinned": places or "none"}
    if divided > 1:
        method = scene.method
        changes |= {"method.dt": method.dt / divided, "method.substeps": method.substeps // divided}
    return scene.replace(changes)


class DecomposedSimulation(Simulation):
    """See model/core/simulation.py for the contract. `windows`: those of this process, simulations of their own, of the
    domains `mine`; `exchange`: what connects them to all others. In `exact` math the bits are those of the sheet as one.

    A backend opens the windows (`_open`) and says how they are connected (`_connect`).
    """

    exchange: Exchange

    def __init__(self, scene: Scene, options: Options, cut: Decomposition, mine: Sequence[int]):
        super().__init__(scene, options)
        reach = family_of(scene).reach
        if reach is not None and not reach(scene).numbered and own_parts(scene, options.live):
            raise SceneError("live", "poke", "pulls a mass of the whole sheet: run it as one, not shared")
        self.decomposition, self.mine = cut, [cut.domains[k] for k in mine]
        self.plan = scene_plan(scene, options.live)
        self.windows: list[Simulation] = []
        try:
            for place, domain in enumerate(self.mine):
                own = replace(options, first_particle=domain.window_first * cut.columns)
                part = window_scene(scene, self.body.pinned, domain, cut.divided)
                with self._at(place), rows_of(self.body, domain.window_first, domain.window_rows):
                    window = self._open(place, part, own)
                    window._bound = self._bound
                    self.windows.append(window)
            self.kernel, self.threads = self.windows[0].kernel, self.windows[0].threads
            self.device = f"{cut.count} x {self.windows[0].device}"
            self.exchange = self._connect()
            self._parameters_changed()
            self.reset()
        except BaseException:
            self.close()
            raise

    def _open(self, place: int, scene: Scene, options: Options) -> Simulation:
        """The simulation of window number `place` of this process."""
        raise NotImplementedError

    def _connect(self) -> Exchange:
        """The exchange of the windows, which have been opened."""
        raise NotImplementedError

    def _at(self, place: int) -> AbstractContextManager[Any]:
        """Where window number `place` of this process is spoken to: its device."""
        return nullcontext()

    def _each(self, do: Callable[[Simulation], Any]) -> list[Any]:
        found = []
        for place, window in enumerate(self.windows):
            with self._at(place):
                found.append(do(window))
        return found

    @property
    def rank(self) -> int:
        return self.exchange.rank

    @property
    def whole_steps(self) -> int:
        """Steps that end with an exchange, an even number of them: what graphs replay."""
        cut = self.decomposition
        return 2 * cut.steps if cut.divided == 1 else 1 + cut.divided % 2

    def slowest(self, seconds: float) -> float:
        return self.exchange.largest(seconds)

    # ------------------------------------------------------------------ the contract

    def _run(self, steps: int) -> None:
        divided = self.decomposition.divided
        self._run_windows(divided * self.step, divided * steps)

    def _run_windows(self, first: int, steps: int) -> None:
        """So many steps of the windows, which count them from `first` on."""
        done = 0
        while done < steps:
            now = min(self.decomposition.steps, steps - done)
            for place, window in enumerate(self.windows):
                window.step = first + done
                with self._at(place):
                    window._run(now)
            self.exchange.post()
            self.exchange.wait()
            done += now

    def _keep(self) -> None:
        self._each(lambda window: window._keep())

    def _restore(self) -> None:
        self._each(lambda window: window._restore())

    def _first_diverged(self) -> int:
        """A halo is as right as what its neighbour owns, so that a window may be looked at as a whole."""
        lowest = NOBODY
        for domain, bad in zip(self.mine, self._each(lambda window: window._first_diverged()), strict=True):
            if bad >= 0:
                lowest = min(lowest, domain.window_first * self.decomposition.columns + bad)
        lowest = int(-self.exchange.largest(-lowest))
        return -1 if lowest == NOBODY else lowest

    def _parameters_changed(self) -> None:
        def send(window: Simulation) -> None:
            window._record, window._clock = self._record, self._clock
            window._poke_particle, window._poke_force = self._poke_particle, self._poke_force
            window._parameters_changed()

        self._each(send)

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        both = self._each(lambda window: window._download())
        columns = self.decomposition.columns
        position, velocity = (
            np.concatenate(
                [
                    state[n][domain.owned.start * columns : domain.owned.stop * columns]
                    for domain, state in zip(self.mine, both, strict=True)
                ]
            )
            for n in range(2)
        )
        return self.exchange.gather(position), self.exchange.gather(velocity)

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        columns = self.decomposition.columns
        for place, (domain, window) in enumerate(zip(self.mine, self.windows, strict=True)):
            held = slice(domain.window_first * columns, domain.window_end * columns)
            with self._at(place):
                window._upload(np.ascontiguousarray(position[held]), np.ascontiguousarray(velocity[held]))

    def synchronize(self) -> None:
        self._each(lambda window: window.synchronize())

    def close(self) -> None:
        self._each(lambda window: window.close())
        self.windows = []
        if "exchange" in self.__dict__:
            self.exchange.close()
