"""A sheet that is stepped in windows of its rows: the simulation that consists of the windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.core.build import some_of
from softlab.model.core.families import family_of, scene_plan
from softlab.model.core.options import Options
from softlab.model.core.own_forces import force_features
from softlab.model.core.sharing.decomposition import Decomposition, Domain, Stencil, decompose
from softlab.model.core.simulation import Simulation
from softlab.model.domains.windows import WindowedSimulation
from softlab.model.scene.scene import Scene


def cut(scene: Scene, count: int, steps: int | None, option: str) -> Decomposition:
    """Return the scene's sheet in `count` domains. Raises SceneError where its family, or a part of it, does not
    support that yet."""
    return decompose(scene.grid.rows, scene.grid.columns, count, stencil_of(scene, count, option), steps, option)


def stencil_of(scene: Scene, count: int, option: str) -> Stencil:
    """Return the rows that a step of the scene's sheet reads. Raises SceneError if the scene cannot be divided."""
    family = family_of(scene)
    if family.stencil is None:
        raise SceneError(
            option, count, f"a {family.name} is not supported on several GPUs or processes; leave {option} out"
        )
    return family.stencil(scene)


def window_scene(scene: Scene, pinned: np.ndarray, domain: Domain, divided: int = 1) -> Scene:
    """Return the scene of a window.

    `pinned`: flat indices of the whole sheet's pinned masses. The initial positions do not matter: its state is loaded,
    and its constants are the sheet's. Its step is one of `divided` parts of the sheet's.
    """
    columns, name = scene.grid.columns, scene.name_of("grid", "cloth") or "grid"
    first, end = domain.window_first * columns, domain.window_end * columns
    inside = pinned[(pinned >= first) & (pinned < end)] - first
    places = [(int(k) // columns, int(k) % columns) for k in inside]
    changes: dict[str, object] = {f"{name}.rows": domain.window_rows, f"{name}.pinned": places or "none"}
    if divided > 1:
        method = scene.method
        changes |= {"method.dt": method.dt / divided, "method.substeps": method.substeps // divided}
    return scene.replace(changes)


class DecomposedSimulation(WindowedSimulation):
    """A simulation in windows of rows (model/domains/windows.py).

    This process simulates the windows of the domains `local`. In `exact` math the bits are those of a single
    simulation.
    """

    def __init__(self, scene: Scene, options: Options, cut: Decomposition, local: Sequence[int]):
        super().__init__(scene, options)
        stencil = family_of(scene).stencil
        if stencil is not None and not stencil(scene).numbered and force_features(scene, options.live):
            raise SceneError("live", "poke", "pulls a mass of the whole sheet; run the scene on one GPU or process")
        self.decomposition, self.local = cut, [cut.domains[k] for k in local]
        self.plan = scene_plan(scene, options.live)
        self.firsts = [domain.window_first * cut.columns for domain in self.local]
        parts = []
        for first, domain in zip(self.firsts, self.local, strict=True):
            window_options = replace(options, first_particle=first)
            window_body = some_of(self.body, slice(first, domain.window_end * cut.columns), domain.window_rows)
            parts.append((window_scene(scene, self.body.pinned, domain, cut.divided), window_options, window_body))
        self._open_windows(cut.count, parts)

    @property
    def whole_steps(self) -> int:
        """Smallest number of steps that ends with an exchange and has an even number of exchanges: graphs replay
        these."""
        cut = self.decomposition
        return 2 * cut.steps if cut.divided == 1 else 1 + cut.divided % 2

    # ------------------------------------------------------------------ methods of Simulation

    def _run(self, steps: int) -> None:
        divided = self.decomposition.divided
        self._run_windows(divided * self.step, divided * steps)

    def _run_windows(self, first: int, steps: int) -> None:
        """Run `steps` steps of the windows, numbered from `first`."""
        done = 0
        while done < steps:
            now = min(self.decomposition.steps, steps - done)
            self._run_each(first + done, now)
            self.exchange.post()
            self.exchange.wait()
            done += now

    def _parameters_changed(self) -> None:
        self._each(lambda window: self._hand_on(window, self._poke_particle))

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        both = self._each(lambda window: window._download())
        columns = self.decomposition.columns
        position, velocity = (
            np.concatenate(
                [
                    state[n][domain.owned.start * columns : domain.owned.stop * columns]
                    for domain, state in zip(self.local, both, strict=True)
                ]
            )
            for n in range(2)
        )
        return self.exchange.gather(position), self.exchange.gather(velocity)

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        columns = self.decomposition.columns

        def send(window: Simulation, domain: Domain) -> None:
            rows = slice(domain.window_first * columns, domain.window_end * columns)
            window._upload(np.ascontiguousarray(position[rows]), np.ascontiguousarray(velocity[rows]))

        self._each(send, self.local)
