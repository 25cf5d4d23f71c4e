"""Configurations that are compared: the lab and its peers at one size, and a peer in the form that timing needs."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import softlab.bench.peers
from softlab.bench.experiments.checks import CHECK_STEPS, FULL_SIZE_STEPS
from softlab.bench.experiments.sweep import source_hash
from softlab.bench.measure.cases import Case
from softlab.bench.peers.bars.tip import Tip
from softlab.bench.peers.base import Opened, Peer, rounding_bound
from softlab.bench.peers.registry import OURS
from softlab.bench.peers.scenes import PeerScene, shape_of
from softlab.bench.store.results import configuration
from softlab.cpu_backend.core.threads import thread_count, threading_layer, wait_policy
from softlab.model.base.errors import Diverged
from softlab.model.core.build import Body
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

MANY_STEPS_UP_TO = 512 * 512  # masses: above, states are compared after fewer steps


@dataclass(frozen=True)
class PeerCase(Case):
    """One configuration of a peer, or (`peer` None) of the lab next to peers."""

    peer: Peer | None = None
    what: str = "grid"  # the word of bench/peers/scenes.py
    check_steps: int = CHECK_STEPS
    scene_bound: float | None = None
    exact: Callable[[Scene], Tip] | None = None

    def __str__(self) -> str:
        rows, columns = shape_of(self.description["scene"])
        name = self.peer.name if self.peer else OURS
        words = [f"{rows} x {columns}", self.what, self.backend, name, self.precision]
        return " ".join(word for word in words if word != "grid")

    @property
    def simulation_kind(self) -> tuple[object, ...]:
        return (self.what, self.backend, self.threads, self.precision, self.peer.name if self.peer else OURS)

    @property
    def steps_checked(self) -> int:
        """Number of steps after which its state is compared."""
        if self.exact is not None:
            return self.exact(self.scene).frames
        return self.check_steps if self.particles <= MANY_STEPS_UP_TO else FULL_SIZE_STEPS

    @property
    def bound(self) -> float:
        """Largest distance of its state [spacings]."""
        if self.scene_bound is not None:
            return self.scene_bound
        return (self.peer.bound if self.peer else rounding_bound)(self.scene, self.precision)


class Beside:
    """A peer's simulation in the form that bench/measure/timing.py needs.

    Every sample restarts from the scene's start, [(position, velocity)].
    """

    snapshots = 0  # the start is always stored

    def __init__(self, peer: Peer, opened: Opened, body: Body):
        self.backend, self.opened = peer.backend, opened
        self.threads = opened.threads or 1
        self.kernel, self.steps_together = opened.kernel, opened.steps_together
        self._body = body

    def advance(self, steps: int) -> None:
        self.opened.advance(steps)

    def synchronize(self) -> None:
        self.opened.synchronize()

    def reset(self) -> None:
        self.opened.load(self._body.position, self._body.velocity)

    rewind = reset

    def load(self, state: State) -> None:
        self.opened.load(state.position, state.velocity)

    def read(self, name: str) -> np.ndarray:
        return self.opened.read()[("position", "velocity").index(name)]

    def check(self, snapshot: bool = True) -> None:
        """Raise Diverged if the state is not finite."""
        for array in self.opened.read():
            if not np.isfinite(array).all():
                raise Diverged(0, int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0]), math.nan, math.nan)


def peer_sources(backend: str) -> str:
    """Return the hash of the code that a comparison depends on: the sources of the backend and of the peers."""
    digest = hashlib.sha256(source_hash(backend).encode())
    for file in sorted(Path(softlab.bench.peers.__file__).parent.rglob("*")):
        if file.suffix in (".py", ".cpp", ".cu"):
            digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def group_of(what: PeerScene, scene: Scene, backend: str, precision: str, peers: Sequence[Peer]) -> list[PeerCase]:
    """Return the lab's case, then those of the peers of one backend that support such scenes, in one precision."""
    threads = thread_count("1x") if backend == "cpu" else None
    cases = []
    sources = peer_sources(backend)
    able = (p for p in peers if p.backend == backend and precision in p.precisions and what.word in p.scenes)
    for peer in (None, *able):
        count = peer.threads(threads or 1) if peer else threads
        description = configuration(
            scene,
            backend=backend,
            threads=count,
            layer=threading_layer() if backend == "cpu" and peer is None else None,
            wait_policy=wait_policy() if backend == "cpu" else None,
            precision=precision,
            peer=peer.name if peer else OURS,
        )
        word = "1x" if backend == "cpu" else None
        cases.append(PeerCase(
            scene, backend, word, count, precision, False, description, sources, peer=peer, what=what.word,
            check_steps=what.check_steps, scene_bound=what.bound, exact=what.tip,
        ))  # fmt: skip
    return cases
