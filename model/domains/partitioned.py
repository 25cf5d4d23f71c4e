"""Bodies whose meshes are stepped in partitions: the simulation that consists of the partitions' windows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.core.build import some_of
from softlab.model.core.families import family_of, scene_plan
from softlab.model.core.options import Options
from softlab.model.core.sharing.partitions import Part, Partitions, partition
from softlab.model.core.simulation import Simulation
from softlab.model.domains.windows import WindowedSimulation, refuse_targets
from softlab.model.particles.particle_set import ParticleSet
from softlab.model.scene.scene import Scene
from softlab.model.tables.parts import Grid


def is_partitioned(scene: Scene, count: int) -> bool:
    """Return True if the scene is shared by partitions of its meshes: it has fewer than `count` bodies.

    Raises SceneError for parts that let bodies act on each other.
    """
    family = family_of(scene)
    if family.partitions is None or family.apart is None:
        return False
    return count > len(family.apart(scene).names)


def partitions(scene: Scene, count: int, steps: int | None, option: str) -> Partitions:
    """Return the scene's meshes in `count` partitions.

    Raises SceneError for parts that let bodies act on each other, for too many partitions, and for `steps` between two
    exchanges, which partitions do not have.
    """
    if steps is not None:
        reason = (
            "applies to a sheet that is shared by its rows: partitions of a mesh exchange once a substep; leave it out"
        )
        raise SceneError("--exchange-every", steps, reason)
    of_family = family_of(scene).partitions
    assert of_family is not None
    return partition(of_family(scene), count, option)


class PartitionedBodies(WindowedSimulation):
    """A simulation in windows of partitions, see model/domains/windows.py.

    `windows` belong to the partitions `local`; one of their steps is a substep of the scene. In `exact` math the bits
    are those of a single simulation.
    """

    def __init__(self, scene: Scene, options: Options, cut: Partitions, local: Sequence[int]):
        refuse_targets(options)
        super().__init__(scene, options)
        self.partitions, self.local = cut, [cut.parts[k] for k in local]
        self.plan, self._sent = scene_plan(scene, options.live), scene
        parts = []
        for part in self.local:
            some = cut.mesh.some((part.particles, part.elements))
            parts.append((self._window_scene(scene, some), options, some_of(self.body, part.particles)))
        self.firsts = [0] * len(parts)
        self._open_windows(cut.count, parts)

    def _window_scene(self, scene: Scene, some: ParticleSet) -> Scene:
        """Return the `scene` with the bodies `some` instead of all, whose step is a substep of the scene."""
        window = scene.stepped(dt=scene.method.dt / scene.method.substeps, substeps=1)
        return window.with_particles(self.partitions.mesh.attribute, some)

    # ------------------------------------------------------------------ methods of Simulation

    def _run(self, steps: int) -> None:
        substeps = self.scene.method.substeps
        for number in range(self.step * substeps, (self.step + steps) * substeps):
            self._run_each(number, 1)
            self.exchange.post()
            self.exchange.wait()

    def _parameters_changed(self) -> None:
        changed, self._sent = self.scene is not self._sent, self.scene

        def send(window: Simulation, part: Part) -> None:
            if changed:
                particles = window.scene.grid
                assert not isinstance(particles, Grid)
                window.scene = self._window_scene(self.scene, particles)
            here = np.flatnonzero(part.particles == self._poke_particle)
            self._hand_on(window, int(here[0]) if len(here) else -1)

        self._each(send, self.local)

    def _gathered(self, owned: Sequence[np.ndarray]) -> np.ndarray:
        """Return the rows of all particles from those of the particles that each part of this process owns."""
        rows = self.exchange.gather(np.ascontiguousarray(np.concatenate(owned)))
        whole = np.empty_like(rows)
        whole[self.partitions.order] = rows
        return whole

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        both = self._each(lambda window, part: [state[part.places] for state in window._download()], self.local)
        return self._gathered([one for one, _ in both]), self._gathered([one for _, one in both])

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._each(lambda window, part: window._upload(position[part.particles], velocity[part.particles]), self.local)

    def _diverged(self) -> list[int]:
        bad_of_each = super()._diverged()
        return [bad if bad < 0 else int(part.particles[bad]) for part, bad in zip(self.local, bad_of_each, strict=True)]

    def _pin_velocity(self, step: int) -> np.ndarray:
        """Return the velocity of the pins in this process's windows; other processes compute those of theirs."""
        velocity = np.zeros((len(self.body.pinned), 3), self.real)

        def fill(window: Simulation, part: Part) -> None:
            here = np.isin(self.body.pinned, part.particles)
            velocity[here] = window._pin_velocity(step * self.scene.method.substeps)

        self._each(fill, self.local)
        return velocity
