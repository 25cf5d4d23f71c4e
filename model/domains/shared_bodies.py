"""Bodies that never collide, stepped in blocks: the simulation that consists of the blocks' windows."""

from __future__ import annotations

from collections.abc import Sequence
from math import prod
from typing import Any

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.core.build import some_of
from softlab.model.core.families import family_of, scene_plan
from softlab.model.core.family import Field, written
from softlab.model.core.options import Options
from softlab.model.core.sharing.bodies import Apart, Block, Division, divide
from softlab.model.core.simulation import Simulation
from softlab.model.domains.windows import WindowedSimulation, refuse_targets
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.simulation import BodiesSimulation
from softlab.model.tables.parts import Grid

TURN = 64  # steps requested of one GPU before the next one: a full queue blocks the caller


def is_apart(scene: Scene) -> bool:
    """Return True if the scene is divided by bodies and not by rows."""
    return family_of(scene).apart is not None


def division(scene: Scene, count: int, steps: int | None, option: str) -> Division:
    """Return the scene's bodies in `count` blocks.

    Raises SceneError for parts that let bodies act on each other, for fewer bodies than blocks, and for `steps` between
    two exchanges, which blocks do not have.
    """
    if steps is not None:
        raise SceneError(
            "--exchange-every",
            steps,
            "applies to a sheet that is shared by its rows: bodies send nothing; leave it out",
        )
    return divide(bodies_of(scene), count, option)


def bodies_of(scene: Scene) -> Apart:
    """Return the scene's bodies. Raises SceneError."""
    apart = family_of(scene).apart
    assert apart is not None
    return apart(scene)


class SharedBodies(BodiesSimulation, WindowedSimulation):
    """A simulation in windows of whole bodies (model/domains/windows.py).

    This process simulates the windows of the blocks `local`. In `exact` math the bits are those of a single simulation.
    """

    def __init__(self, scene: Scene, options: Options, division: Division, local: Sequence[int]):
        refuse_targets(options)
        super().__init__(scene, options)
        self.division, self.local = division, [division.blocks[k] for k in local]
        self.plan, self._apart = scene_plan(scene, options.live), bodies_of(scene)
        self.firsts = [block.first_particle for block in self.local]
        self._sent = scene
        of_each = [self._apart.clusters(block.first, block.end) for block in division.blocks]
        self._clusters, self._local_clusters = np.concatenate(of_each), [of_each[k] for k in local]
        parts = []
        for block in self.local:
            some = self._apart.some(block.first, block.end)
            parts.append(
                (scene.with_particles(self._apart.attribute, some), options, some_of(self.body, block.particles))
            )
        self._open_windows(division.count, parts)

    def _gathered(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        """Return the rows of all blocks, in their order, from those of each block of this process."""
        owned = np.ascontiguousarray(np.concatenate(arrays))
        row = owned.shape[1:]
        return self.exchange.gather(owned.reshape(len(owned), prod(row))).reshape(-1, *row)

    def _by_cluster(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        """Return rows of clusters in the order of the scene's."""
        gathered = self._gathered(arrays)
        whole = np.empty_like(gathered)
        whole[self._clusters] = gathered
        return whole

    # ------------------------------------------------------------------ methods of Simulation

    def _run(self, steps: int) -> None:
        turn = TURN if len(self.windows) > 1 else steps
        for done in range(0, steps, turn):
            self._run_each(self.step + done, min(turn, steps - done))

    def _parameters_changed(self) -> None:
        changed, self._sent = self.scene is not self._sent, self.scene

        def send(window: Simulation, block: Block) -> None:
            if changed:
                particles = window.scene.grid
                assert not isinstance(particles, Grid)
                window.scene = self.scene.with_particles(self._apart.attribute, particles)
            here = block.first_particle <= self._poke_particle < block.end_particle
            self._hand_on(window, self._poke_particle - block.first_particle if here else -1)

        self._each(send, self.local)

    def _weights_changed(self) -> None:
        def send(window: BodiesSimulation, block: Block) -> None:
            window.body = some_of(self.body, block.particles)
            window._weights_changed()

        self._each(send, self.local)

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        both = self._each(lambda window: window._download())
        return self._gathered([one for one, _ in both]), self._gathered([one for _, one in both])

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        def send(window: Simulation, block: Block) -> None:
            particles = block.particles
            window._upload(np.ascontiguousarray(position[particles]), np.ascontiguousarray(velocity[particles]))

        self._each(send, self.local)

    def _read_field(self, field: Field, into: object) -> Any:
        if field.rows != "clusters":
            return super()._read_field(field, into)
        return written(self._by_cluster(self._each(lambda window: window._read_field(field, None))), into)

    def _download_field(self, field: Field) -> np.ndarray | None:
        arrays = self._each(lambda window: window._download_field(field))
        return None if arrays[0] is None else self._by_cluster(arrays)

    def _upload_field(self, field: Field, array: np.ndarray | None) -> None:
        self._each(
            lambda window, clusters: window._upload_field(field, None if array is None else array[clusters]),
            self._local_clusters,
        )

    def _read_clusters(self) -> tuple[np.ndarray, np.ndarray]:
        both = self._each(lambda window: window._read_clusters())
        return self._by_cluster([one for one, _ in both]), self._by_cluster([one for _, one in both])

    def _pin_velocity(self, step: int) -> np.ndarray:
        """Return the velocity of the pins in this process's blocks; other processes compute those of theirs."""
        velocity = np.zeros((len(self.body.pinned), 3), self.real)

        def fill(window: Simulation, block: Block) -> None:
            first, end = np.searchsorted(self.body.pinned, (block.first_particle, block.end_particle))
            velocity[first:end] = window._pin_velocity(step)

        self._each(fill, self.local)
        return velocity
