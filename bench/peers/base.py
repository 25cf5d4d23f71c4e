"""The contract of a peer: another program, or another way to write this one, that runs a scene of the lab.

A peer is told apart by `name`; it says what it runs on (`backend`), which scenes it knows (`refusal`), and whether it is
here (`available`). `open` gives a simulation reduced to what a comparison needs. To add one: a file with a subclass of
`Peer`, and its name in registry.py.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from bench.experiments.checks import CHECK_ROWS, LIMITS
from bench.peers.bars.tip import Tip
from model.core.build import build
from model.core.parameters import PARAMETERS, parameter_record
from model.core.simulation import PRECISIONS
from model.mass_spring.plan import present_parts
from model.scene.scene import Scene


class Opened(ABC):
    """A scene opened by a peer; a context manager. `kernel`: what runs, in a word or two; `threads`: None on the GPU;
    `steps_together`: steps of one pass over memory."""

    kernel: str = "auto"
    threads: int | None = None
    steps_together: int = 1

    @abstractmethod
    def advance(self, steps: int) -> None:
        """Do `steps` steps of `method.dt` each; may return before they are done."""

    @abstractmethod
    def synchronize(self) -> None:
        """Return when every step asked for has been done."""

    @abstractmethod
    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Continue from (particles, 2) arrays [m], [m/s], in builder order (row-major, row 0 on top)."""

    @abstractmethod
    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """(position [m], velocity [m/s]), (particles, 2) each, in builder order and the precision opened with."""

    def close(self) -> None:  # noqa: B027 - nothing to free is a valid answer
        """Free what is held; nothing else may be called after it."""

    def __enter__(self) -> Opened:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Peer(ABC):
    """Something a user could pick instead. `name`: its key in the store, for good; `label`: as figures call it;
    `backend`: "cpu" or "gpu"; `precisions`: what it can be opened in; `scenes`: words of bench/peers/scenes.py."""

    name: str
    label: str
    backend: str
    precisions: tuple[str, ...] = ("float32", "float64")
    scenes: tuple[str, ...] = ("grid",)

    @abstractmethod
    def available(self) -> tuple[bool, str]:
        """(whether it can run here, with what; or else why not and how to get it). Never raises."""

    def refusal(self, scene: Scene) -> str | None:
        """Why it cannot run this scene, or None. Peers of other scenes than the grid override this."""
        return grid_refusal(scene)

    def bound(self, scene: Scene, precision: str) -> float:
        """Spacings that its answer may be off the lab's, by the root mean square: rounding, unless a peer approaches the
        scene's method and overrides this."""
        return rounding_bound(scene, precision)

    def tip(self, scene: Scene) -> Tip | None:
        """Of a bar that is held against an exact answer (bench/peers/bars/tip.py): that of the peer's own law, None where the
        scene's is its own."""
        return None

    def threads(self, wanted: int) -> int | None:
        """Threads that it runs on when `wanted` are to be had; None on the GPU."""
        return wanted if self.backend == "cpu" else None

    @abstractmethod
    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        """The scene at its start. Raises PeerError where that fails (compiler, driver, memory)."""


def rounding_bound(scene: Scene, precision: str) -> float:
    """Spacings: the bound of the lab's own kernels, in coordinates as large as the sheet is wide."""
    return LIMITS[precision] * max(1.0, max(scene.grid.rows, scene.grid.columns) / CHECK_ROWS)


class PeerError(RuntimeError):
    """A peer that looked as if it were here, and is not; the text says why."""


def grid_refusal(scene: Scene) -> str | None:
    """Why a peer of the lab's grid (springs, damping, gravity, pins, the hand-out's step) cannot run the scene."""
    if scene.method.solver != "mass-spring":
        return f"it has no {scene.method.solver} solver"
    if scene.method.integrator != "lab":
        return f"it knows the lab's step alone, not {scene.method.integrator}"
    if scene.springs is None:
        return "it has no grid without springs"
    if scene.springs.alternate:
        return "it knows one stiffness, these springs alternate"
    if scene.manufactured is not None or (scene.external is not None and scene.external.magnitude > 0):
        return "it has no external force"
    unknown = present_parts(scene) - {"springs", "damping", "gravity", "pins"}
    return f"it does not know {', '.join(sorted(unknown))}" if unknown else None


class SheetStart:
    """A sheet as it starts, in the arithmetic of a peer.

    `real`: the numpy type; `rows`, `columns`, `count` of masses; `pinned`: the indices of those that stay; `position`,
    `velocity` (particles, axes); `free` (rows, columns) bool.
    """

    def __init__(self, scene: Scene, precision: str):
        self.real: Any = PRECISIONS[precision]
        body = build(scene)
        self.rows, self.columns, self.count = body.rows, body.columns, len(body.position)
        self.pinned = body.pinned
        self.position = body.position.astype(self.real)
        self.velocity = body.velocity.astype(self.real)

    @property
    def free(self) -> np.ndarray:
        """(rows, columns) bool: the masses that move."""
        free = np.ones(self.count, bool)
        free[self.pinned] = False
        return free.reshape(self.rows, self.columns)


class GridConstants(SheetStart):
    """What a step of the grid needs, rounded once: the numbers that the lab's own kernels read.

    `dt`, `half_dt_squared`, `stiffness` (over mass), `stiffness_rest`, `damping` (over mass), `gravity` (along +y): Python
    floats that `real` holds exactly.
    """

    def __init__(self, scene: Scene, precision: str):
        super().__init__(scene, precision)
        record = dict(zip(PARAMETERS, parameter_record(scene, self.real)[0].tolist(), strict=True))
        self.dt, self.half_dt_squared = record["dt"], record["half_dt_squared"]
        self.stiffness, self.stiffness_rest = record["stiffness"], record["stiffness_rest"]
        self.damping, self.gravity = record["damping"], record["gravity"]

    @property
    def in_order(self) -> tuple[float, ...]:
        """stiffness, stiffness_rest, damping, gravity, dt, half_dt_squared: how the compiled peers take them."""
        return (self.stiffness, self.stiffness_rest, self.damping, self.gravity, self.dt, self.half_dt_squared)


class SheetConstants:
    """What a peer needs that is given masses and springs one by one, rounded once. See GridConstants.

    `inverse_mass` (particles,) [1/kg], 0 where pinned; `drag` [1/s]: of every mass, c / m; `gravity` [m/s^2] along +y.
    """

    def __init__(self, scene: Scene, precision: str):
        self.real: Any = PRECISIONS[precision]
        body = build(scene)
        self.count, self.pinned = len(body.position), body.pinned
        self.position = body.position.astype(self.real)
        self.velocity = body.velocity.astype(self.real)
        self.inverse_mass = body.inverse_mass.astype(self.real)
        self.drag = scene.damping.coefficient / scene.grid.mass if scene.damping else 0.0
        self.gravity = -scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0
