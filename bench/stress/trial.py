"""One hard case under one method, backend and precision: opening, running and judging it without ever hanging or
handing out a broken state.

A case's law returns `Check`s, each a measured number beside its bound. What a run may do instead is refuse to start
(UnstableTimeStep, SceneError), break with a report (Diverged), or one of the two things that no run may do: end with
numbers that are not finite and say nothing (`SilentNaN`), or not end (`Endless`).
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.driver import open_simulation
from bench.experiments.accuracy.solver_error import ORDERINGS
from bench.reference import mass_spring as reference
from bench.reference import xpbd
from model.core.build import build
from model.core.errors import Diverged, SoftlabError
from model.core.families import stability_limit
from model.core.simulation import Simulation, State
from model.scene.scene import Scene

PATIENCE = 300.0  # s of wall time for one run; looked at between chunks of steps
CHUNK = 2000  # steps
RESIDUAL = 1e-9  # N: the force that may be left on a free mass at rest, in float64
REST = 60.0  # s: by then almost every damped grid of ten masses a side has settled
PARTS = 4  # times REST is waited for the others
STILL = 1e-9  # m/s: the speed that counts as rest, in float64


class SilentNaN(SoftlabError):
    """A run ended with numbers that are not finite and reported nothing: a bug of this lab."""


class Endless(SoftlabError):
    """A run did not end within PATIENCE: a bug of this lab, or a very slow machine."""


@dataclass(frozen=True)
class Check:
    """A measured quantity and its bound. `relation`: `<`, `>`; `aim <=` for a bound that is told, but not part of the
    verdict (a time, which another program may spoil); empty for a number without a bound."""

    name: str
    value: float
    unit: str
    relation: str = ""
    bound: float = 0.0

    @property
    def good(self) -> bool:
        return {"<": self.value < self.bound, ">": self.value > self.bound}.get(self.relation, True)

    @property
    def bound_text(self) -> str:
        """`< 1e-09 N`; empty for a number that is not judged."""
        return f"{self.relation} {self.bound:.3g} {self.unit}".rstrip() if self.relation else ""

    def __str__(self) -> str:
        return f"{self.name} {self.value:.3g} {self.unit}".rstrip() + (
            f", must be {self.bound_text}" if self.relation else ""
        )


class Trial:
    """A scene to be run by a case's law. `live`: compiled in for every opening, so that tests share kernels; `timed`:
    laws about time are judged. `end`: the positions (particles, dimensions) [m] to be shown, those of the last state unless
    a law says otherwise, or None; `end_time` [s]: when that was."""

    def __init__(
        self,
        scene: Scene,
        backend: str = "cpu",
        precision: str = "float64",
        *,
        math: str = "fast",
        kernel: str | None = None,
        threads: str | int = "1x",
        live: Iterable[str] = (),
        timed: bool = True,
    ):
        self.scene, self.backend, self.precision = scene, backend, precision
        self.math, self.kernel, self.threads = math, kernel, threads
        self.live, self.timed = frozenset(live), timed
        self.end: np.ndarray | None = None
        self.end_time = 0.0
        self._deadline = time.perf_counter() + PATIENCE

    @property
    def dt(self) -> float:
        return self.scene.method.dt

    @property
    def single(self) -> bool:
        """Whether it runs in float32."""
        return self.precision == "float32"

    @property
    def is_lab(self) -> bool:
        """Whether it runs the hand-out's step, which moves as if masses were double, and so settles half as fast."""
        return self.scene.method.name == "lab"

    def steps(self, seconds: float) -> int:
        """Whole steps [1] in `seconds` [s]."""
        return max(1, round(seconds / self.dt))

    def rest(self) -> np.ndarray:
        """The drawn sheet (rows, columns, dimensions) float64 [m]."""
        return reference.rest(self.scene).astype(np.float64)

    def expected(self, steps: int, initial: State | None = None) -> np.ndarray:
        """The reference's positions (particles, dimensions) [m] after `steps` steps of the scene's method (None: from its
        own start)."""
        scene, method = self.scene, self.scene.method
        begin = (None, None) if initial is None else (initial.position, initial.velocity)
        if not method.position_based:
            return reference.simulate(scene, steps, *begin)[0]
        ordering = ORDERINGS.get(method.ordering, method.ordering)
        how = {"substeps": method.substeps, "iterations": method.iterations, "ordering": ordering}
        return xpbd.simulate(scene, steps, *begin, **how)[0]  # type: ignore[arg-type]

    def start(self, position: np.ndarray, velocity: np.ndarray | None = None) -> State:
        """A state at time 0; `position` [m] and `velocity` [m/s] (None: at rest) of any shape, a number an axis a mass."""
        position = np.array(position, dtype=np.float64).reshape(-1, self.scene.dimensions)
        velocity = (
            np.zeros_like(position) if velocity is None else np.array(velocity, np.float64).reshape(position.shape)
        )
        return State(position, velocity, build(self.scene).inverse_mass, 0.0, 0)

    def open(
        self,
        initial: State | None = None,
        *,
        live: Iterable[str] = (),
        allow_unstable: bool = False,
        scene: Scene | None = None,
    ) -> Simulation:
        """The simulation, from `initial`. Raises UnstableTimeStep unless `allow_unstable`, and what opening raises."""
        return open_simulation(
            scene or self.scene, self.backend, threads=self.threads, precision=self.precision, math=self.math,
            kernel=self.kernel, live=self.live | set(live), initial=initial, allow_unstable=allow_unstable,
        )  # fmt: skip

    def look(self, simulation: Simulation) -> State:
        """The state. Raises Diverged (the last finite state then is `end`), or SilentNaN."""
        try:
            state = simulation.state()
        except Diverged:
            self._show_last(simulation)
            raise
        if not (np.isfinite(state.position).all() and np.isfinite(state.velocity).all()):
            raise SilentNaN("the state holds numbers that are not finite, and nothing was reported: a bug of the lab")
        self.show(state)
        return state

    def show(self, state: State | None) -> None:
        """Draw this state, if any, and none before it."""
        if state is not None:
            self.end, self.end_time = state.position.astype(np.float64), state.time

    def _show_last(self, simulation: Simulation) -> None:
        """The last finite state of a run that diverged."""
        self.end, self.end_time = simulation.read("position").astype(np.float64), simulation.time

    def advance(self, simulation: Simulation, steps: int) -> None:
        """Step, looking at the clock. Raises Diverged, or Endless."""
        try:
            while steps > 0:
                batch = min(steps, CHUNK)
                simulation.advance(batch)
                simulation.synchronize()
                steps -= batch
                if time.perf_counter() > self._deadline:
                    raise Endless(f"not done after {PATIENCE:.0f} s, {steps} steps before the end")
        except Diverged:
            self._show_last(simulation)
            raise

    def watch(self, looks: Iterable[int], initial: State | None = None, **how: Any) -> Iterator[State]:
        """The states after so many steps each, of one run; `how`: of `open`. Raises what `advance` and `look` raise."""
        with self.open(initial, **how) as simulation:
            for step in looks:
                self.advance(simulation, step - simulation.step)
                yield self.look(simulation)

    def run(self, initial: State | None, seconds: float, *, allow_unstable: bool = False) -> State:
        """The state after `seconds` [s]; None: from the scene's own start."""
        with self.open(initial, allow_unstable=allow_unstable) as simulation:
            self.advance(simulation, self.steps(seconds))
            return self.look(simulation)

    def settle(self, simulation: Simulation) -> tuple[State, list[Check]]:
        """Go on for 60 s, and where a mode is so soft that the net still moves, up to four times as long: the state at
        rest, its checks, and the time that it took. Raises what `advance` and `look` raise."""
        for k in range(1, PARTS + 1):
            self.advance(simulation, self.steps(k * REST) - simulation.step)
            state = self.look(simulation)
            checks = self.rest_checks(state)
            if all(check.good for check in checks):
                break
        return state, [*checks, Check("looked at rest after", k * REST, "s", "aim <=", REST)]

    # ------------------------------------------------------------------ what laws ask for

    def residual(self, position: np.ndarray) -> float:
        """The largest net force [N] on a free mass of a grid at `position` (particles, 2), by the reference's formulas."""
        grid = self.scene.grid
        force = reference.spring_forces(self.scene, position.astype(np.float64).reshape(grid.rows, grid.columns, 2))
        if self.scene.gravity and self.scene.gravity.enabled:
            force[..., 1] -= grid.mass * self.scene.gravity.acceleration
        return float(np.abs(force[~reference.pinned_mask(self.scene)]).max(initial=0.0))

    def rest_checks(self, state: State) -> list[Check]:
        """At rest (fact 4 of docs/method.md): slow, and no force left, whatever the shape.

        In float32 rounding ends the approach: a coordinate of magnitude `size` has the ulp u, so forces are known to 8 k u
        (four springs, two ends each); the hand-out's step no longer moves when dt^2 a / 2 < u / 2, a force of m u / dt^2,
        the steps that store a velocity when dt v < u / 2, whose damper then carries c u / (2 dt). Twice that is allowed, and
        speeds of 4 u / dt, since the hand-out's are whole multiples of u / dt.
        """
        force, speed = RESIDUAL, STILL
        if self.single:
            u = float(np.spacing(np.float32(np.abs(state.position).max())))
            springs, damping = self.scene.springs, self.scene.damping
            rounding = 8 * (springs.largest_stiffness if springs else 0.0) * u
            stop = self.scene.grid.mass * u / self.dt**2 if self.is_lab else 0.0
            drag = (damping.coefficient if damping else 0.0) * u / (2 * self.dt)
            force, speed = rounding + 2 * (stop + drag), 4 * u / self.dt
        return [
            Check("residual force", self.residual(state.position), "N", "<", force),
            Check("speed", float(np.abs(state.velocity).max()), "m/s", "<", speed),
        ]

    def limit(self) -> float:
        """The largest dt [s] that holds in any state of the scene."""
        return stability_limit(self.scene)
