"""Interface of a peer: another program, or another implementation of this one, that runs a scene of the lab.

A peer is identified by `name`; it reports its `backend`, the scenes that it cannot run (`refusal`), and whether it is
installed (`available`). `open` returns a simulation with the methods that a comparison needs. To add one: a file with a
subclass of `Peer`, and its name in registry.py.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from softlab.bench.experiments.checks import CHECK_ROWS, LIMITS
from softlab.bench.peers.bars.tip import Tip
from softlab.model.base.errors import SoftlabError
from softlab.model.contact.sheet_plan import present_parts
from softlab.model.core.build import build
from softlab.model.core.parameters import PARAMETERS, parameter_record
from softlab.model.core.simulation import PRECISIONS
from softlab.model.scene.scene import Scene


class Opened(ABC):
    """A scene opened by a peer; a context manager.

    `kernel`: the kernel, in a word or two; `threads`: None on the GPU; `steps_together`: steps per pass over memory.
    """

    kernel: str = "auto"
    threads: int | None = None
    steps_together: int = 1

    @abstractmethod
    def advance(self, steps: int) -> None:
        """Do `steps` steps of `method.dt` each; may return before they are done."""

    @abstractmethod
    def synchronize(self) -> None:
        """Return when every requested step has been done."""

    @abstractmethod
    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Continue from (particles, 2) arrays [m], [m/s], in builder order (row-major, row 0 on top)."""

    @abstractmethod
    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (position [m], velocity [m/s]), (particles, 2) each, in builder order and the precision of the
        simulation.
        """

    def close(self) -> None:  # noqa: B027 - nothing to free is a valid answer
        """Free the resources; nothing else may be called after it."""

    def __enter__(self) -> Opened:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Peer(ABC):
    """Program that a user could choose instead.

    `name`: its permanent key in the store; `label`: its name in figures; `backend`: "cpu" or "gpu"; `precisions`:
    supported ones; `scenes`: words of bench/peers/scenes.py.
    """

    name: str
    label: str
    backend: str
    precisions: tuple[str, ...] = ("float32", "float64")
    scenes: tuple[str, ...] = ("grid",)

    @abstractmethod
    def available(self) -> tuple[bool, str]:
        """Return (True, its version) if it can run here, else (False, the reason and how to get it). Never raises."""

    def refusal(self, scene: Scene) -> str | None:
        """Return why it cannot run this scene, or None. Peers of other scenes than the grid override this."""
        return grid_refusal(scene)

    def bound(self, scene: Scene, precision: str) -> float:
        """Return the largest root mean square distance [spacings] of its state from the lab's.

        It is rounding, unless a peer approaches the scene's method and overrides this.
        """
        return rounding_bound(scene, precision)

    def tip(self, scene: Scene) -> Tip | None:
        """Return the exact result of the peer's own law for a bar, or None if the scene's law is its own.

        For bars that are compared with an exact result (bench/peers/bars/tip.py).
        """
        return None

    def threads(self, wanted: int) -> int | None:
        """Return the threads that it uses if `wanted` are available; None on the GPU."""
        return wanted if self.backend == "cpu" else None

    @abstractmethod
    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        """Open the scene at its start. Raises PeerError if that fails (compiler, driver, memory)."""


def rounding_bound(scene: Scene, precision: str) -> float:
    """Return the bound of the lab's own kernels [spacings], for coordinates as large as the sheet is wide."""
    return LIMITS[precision] * max(1.0, max(scene.grid.rows, scene.grid.columns) / CHECK_ROWS)


class PeerError(SoftlabError):
    """A peer that seemed to be available is not; the text has the reason."""


def grid_refusal(scene: Scene) -> str | None:
    """Return why a peer of the lab's grid (springs, damping, gravity, pins, the hand-out's step) cannot run the scene."""
    if scene.method.solver != "mass-spring":
        return f"it has no {scene.method.solver} solver"
    if scene.method.integrator != "lab":
        return f"it supports only the integrator lab, not {scene.method.integrator}"
    if scene.springs is None:
        return "it has no grid without springs"
    if scene.springs.alternate:
        return "it supports one stiffness; these springs alternate"
    if scene.external is not None and scene.external.magnitude > 0:
        return "it has no external force"
    unknown = present_parts(scene) - {"springs", "damping", "gravity", "pins"}
    return f"it does not support {', '.join(sorted(unknown))}" if unknown else None


class SheetStart:
    """Start of a sheet, in the arithmetic of a peer.

    `real`: the numpy type; `rows`, `columns`, `count` of masses; `pinned`: the indices of pinned ones; `position`,
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
        """Mask (rows, columns) of the masses that move."""
        free = np.ones(self.count, bool)
        free[self.pinned] = False
        return free.reshape(self.rows, self.columns)


class GridConstants(SheetStart):
    """Constants of a step of the grid, rounded once: the numbers that the lab's own kernels read.

    `dt`, `half_dt_squared`, `stiffness` (over mass), `stiffness_rest`, `damping` (over mass), `gravity` (along +y):
    Python floats that `real` represents exactly.
    """

    def __init__(self, scene: Scene, precision: str):
        super().__init__(scene, precision)
        record = dict(zip(PARAMETERS, parameter_record(scene, self.real)[0].tolist(), strict=True))
        self.dt, self.half_dt_squared = record["dt"], record["half_dt_squared"]
        self.stiffness, self.stiffness_rest = record["stiffness"], record["stiffness_rest"]
        self.damping, self.gravity = record["damping"], record["gravity"]

    @property
    def in_order(self) -> tuple[float, ...]:
        """Stiffness, stiffness_rest, damping, gravity, dt, half_dt_squared, in the order of the compiled peers."""
        return (self.stiffness, self.stiffness_rest, self.damping, self.gravity, self.dt, self.half_dt_squared)


class SheetConstants:
    """Constants for a peer that gets masses and springs one by one, rounded once, like `GridConstants`.

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
