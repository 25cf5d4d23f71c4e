"""A cloth without a solver, for tests of the drawing: masses that fall and are pushed, each by itself, in NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.core.families import scene_plan
from softlab.model.core.plan import Plan
from softlab.model.core.simulation import Options
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.simulation import BodiesSimulation

DAMPING = 100.0  # 1/s: a pull that is renewed once a frame of 0.01 s settles, with no neighbours to hold the mass


class FakeCloth(BodiesSimulation):
    """Every mass under gravity, the poke and a strong damper. `asked`: the names that were read, in order."""

    backend, device, threads, kernel = "cpu", "none", 1, "fake"
    plan: Plan
    contacts_lost = speed_limited = not_emitted = 0
    done = (0, 0, 0, 0, 0)  # counters of Newton's method

    def __init__(self, scene: Scene, options: Options | None = None):
        super().__init__(scene, options or Options(live=frozenset({"gravity", "poke", "dt"})))
        self.plan = scene_plan(scene, self.options.live)
        self.asked: list[str] = []
        self._velocity = np.zeros_like(self.body.position)
        self._position = self.body.position.copy()
        self._store_snapshot()

    def _run(self, steps: int) -> None:
        gravity, dt = self.scene.gravity, self.scene.method.dt
        pull = np.zeros(3)
        pull[1] = -gravity.acceleration if gravity and gravity.enabled else 0.0
        free = (self.body.inverse_mass > 0)[:, None]
        for _ in range(steps):
            push = np.zeros_like(self._position)
            if self._poke_particle >= 0:
                push[self._poke_particle] = np.array(self._poke_force) / self.scene.grid.mass
            self._velocity += dt * (pull + push - DAMPING * self._velocity) * free
            self._position += dt * self._velocity

    def _store_snapshot(self) -> None:
        self._aside = self._position.copy(), self._velocity.copy()

    def _restore(self) -> None:
        self._position, self._velocity = (array.copy() for array in self._aside)

    def _first_diverged(self) -> int:
        bad = np.flatnonzero(~(np.abs(self._position) <= self._bound).all(axis=1))
        return int(bad[0]) if len(bad) else -1

    def _parameters_changed(self) -> None:
        pass

    def _weights_changed(self) -> None:
        pass

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        return self._position.astype(self.real), self._velocity.astype(self.real)

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._position, self._velocity = position.astype(np.float64), velocity.astype(np.float64)

    def synchronize(self) -> None:
        pass

    def read(self, name: str, into: Any = None) -> Any:
        self.asked.append(name)
        return super().read(name, into)

    # arrays of the state of bodies, which hang still

    def _upload_rotation(self, rotation: Any) -> None:
        pass

    def _upload_plastic(self, plastic: Any) -> None:
        pass

    def _download_rotation(self) -> None:
        return None

    def _read_clusters(self) -> tuple[np.ndarray, np.ndarray]:
        raise NotImplementedError

    def _download_plastic(self) -> None:
        return None


def open_fake(scene: Scene, backend: str, *, live: Any = (), initial: Any = None, **options: Any) -> FakeCloth:
    """As `open_simulation`, for `Demo(open_world=open_fake)`."""
    if backend != "cpu":
        raise SceneError("--backend", backend, "must be cpu")
    simulation = FakeCloth(scene, Options(live=frozenset(live)))
    if initial is not None:
        simulation.load(initial)
    return simulation
