"""One hard case by one method, backend and precision: opened, run and checked without hanging or a broken state.

A case's law returns `Check`s, each a measured number with its bound. Instead, a run may refuse to start
(UnstableTimeStep, SceneError) or stop with a report (Diverged). Two outcomes are bugs: to end with numbers that are not
finite without a report (`SilentNaN`), or not to end (`Endless`).
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments.accuracy.solver_error import ORDERINGS
from softlab.bench.reference import mass_spring as reference
from softlab.bench.reference import xpbd
from softlab.model.base.errors import Diverged, SoftlabError
from softlab.model.core.build import build
from softlab.model.core.families import stability_limit
from softlab.model.core.simulation import Simulation, State
from softlab.model.scene.scene import Scene

PATIENCE = 300.0  # s of wall time for one run; checked between chunks of steps
CHUNK = 2000  # steps
RESIDUAL = 1e-9  # N: residual force on a free mass at rest, in float64
REST = 60.0  # s: almost every damped grid of ten masses per side has settled by then
PARTS = 4  # largest number of REST periods for the others
STILL = 1e-9  # m/s: largest speed at rest, in float64


class SilentNaN(SoftlabError):
    """A run ended with numbers that are not finite, without a report: a bug of this lab."""


class Endless(SoftlabError):
    """A run did not end within PATIENCE: a bug of this lab, or a very slow machine."""


@dataclass(frozen=True)
class Check:
    """A measured quantity and its bound.

    `relation`: `<`, `>`; `aim <=` for a bound that is reported but not part of the verdict (a time, which another
    program may disturb); empty for a number without a bound.
    """

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
        """Text of the bound, e.g. `< 1e-09 N`; empty for a number without one."""
        return f"{self.relation} {self.bound:.3g} {self.unit}".rstrip() if self.relation else ""

    def __str__(self) -> str:
        return f"{self.name} {self.value:.3g} {self.unit}".rstrip() + (
            f", must be {self.bound_text}" if self.relation else ""
        )


class Trial:
    """A scene that a case's law runs.

    `live`: fields compiled as live in every opening, so that tests share kernels; `timed`: laws on times are checked.
    `end`: the positions (particles, dimensions) [m] to draw, those of the last state unless a law chooses others, or
    None; `end_time` [s]: their time.
    """

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
        """True if the run uses float32."""
        return self.precision == "float32"

    @property
    def is_lab(self) -> bool:
        """True if the run uses the hand-out's step, which moves as if masses were doubled, and so settles half as fast."""
        return self.scene.method.name == "lab"

    def steps(self, seconds: float) -> int:
        """Return the number of whole steps in `seconds` [s]."""
        return max(1, round(seconds / self.dt))

    def rest(self) -> np.ndarray:
        """Return the sheet's rest positions (rows, columns, dimensions) float64 [m]."""
        return reference.rest(self.scene).astype(np.float64)

    def expected(self, steps: int, initial: State | None = None) -> np.ndarray:
        """Return the reference's positions (particles, dimensions) [m] after `steps` steps of the scene's method.

        `initial` None: from the scene's own start.
        """
        scene, method = self.scene, self.scene.method
        begin = (None, None) if initial is None else (initial.position, initial.velocity)
        if not method.position_based:
            return reference.simulate(scene, steps, *begin)[0]
        ordering = ORDERINGS.get(method.ordering, method.ordering)
        return xpbd.simulate(
            scene, steps, *begin, substeps=method.substeps, iterations=method.iterations, ordering=ordering
        )[0]

    def start(self, position: np.ndarray, velocity: np.ndarray | None = None) -> State:
        """Return a state at time 0.

        `position` [m] and `velocity` [m/s] (None: at rest) may have any shape with one number per axis and mass.
        """
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
        """Open the simulation from `initial`. Raises UnstableTimeStep unless `allow_unstable`, and other errors of
        opening.
        """
        return open_simulation(
            scene or self.scene, self.backend, threads=self.threads, precision=self.precision, math=self.math,
            kernel=self.kernel, live=self.live | set(live), initial=initial, allow_unstable=allow_unstable,
        )  # fmt: skip

    def checked_state(self, simulation: Simulation) -> State:
        """Return the checked state. Raises Diverged (with the last finite state as `end`), or SilentNaN."""
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
        """Draw this state, if any, instead of an earlier one."""
        if state is not None:
            self.end, self.end_time = state.position.astype(np.float64), state.time

    def _show_last(self, simulation: Simulation) -> None:
        """Set `end` to the last finite state of a run that diverged."""
        self.end, self.end_time = simulation.read("position").astype(np.float64), simulation.time

    def advance(self, simulation: Simulation, steps: int) -> None:
        """Advance by `steps`, within the time limit. Raises Diverged, or Endless."""
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

    def watch(self, steps: Iterable[int], initial: State | None = None, scene: Scene | None = None) -> Iterator[State]:
        """Yield the states after each number of steps in `steps`, of one run from `initial`; `scene` in place of the
        trial's.

        Raises the errors of `advance` and `checked_state`.
        """
        with self.open(initial, scene=scene) as simulation:
            for step in steps:
                self.advance(simulation, step - simulation.step)
                yield self.checked_state(simulation)

    def run(self, initial: State | None, seconds: float, *, allow_unstable: bool = False) -> State:
        """Return the state after `seconds` [s]; `initial` None: from the scene's own start."""
        with self.open(initial, allow_unstable=allow_unstable) as simulation:
            self.advance(simulation, self.steps(seconds))
            return self.checked_state(simulation)

    def settle(self, simulation: Simulation) -> tuple[State, list[Check]]:
        """Continue for 60 s, and up to four times as long if the net still moves because of a soft mode.

        Returns the state at rest and its checks, including the time. Raises the errors of `advance` and
        `checked_state`.
        """
        for k in range(1, PARTS + 1):
            self.advance(simulation, self.steps(k * REST) - simulation.step)
            state = self.checked_state(simulation)
            checks = self.rest_checks(state)
            if all(check.good for check in checks):
                break
        return state, [*checks, Check("looked at rest after", k * REST, "s", "aim <=", REST)]

    # ------------------------------------------------------------------ quantities of laws

    def residual(self, position: np.ndarray) -> float:
        """Largest net force [N] on a free mass of a grid at `position` (particles, 2), by the reference's formulas."""
        grid = self.scene.grid
        force = reference.spring_forces(self.scene, position.astype(np.float64).reshape(grid.rows, grid.columns, 2))
        if self.scene.gravity and self.scene.gravity.enabled:
            force[..., 1] -= grid.mass * self.scene.gravity.acceleration
        return float(np.abs(force[~reference.pinned_mask(self.scene)]).max(initial=0.0))

    def rest_checks(self, state: State) -> list[Check]:
        """Checks of rest (fact 4 of docs/method/cases.md): slow, and without a residual force, whatever the shape.

        In float32 rounding ends the approach to rest. A coordinate of magnitude `size` has the ulp u, so forces have an
        error of 8 k u (four springs, two ends each). The hand-out's step stops moving when dt^2 a / 2 < u / 2, a force
        of m u / dt^2; the steps that store a velocity when dt v < u / 2, whose damper then carries c u / (2 dt). Twice
        that is allowed, and speeds of 4 u / dt, since those of the hand-out are whole multiples of u / dt.
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
        """Largest dt [s] that is stable in any state of the scene."""
        return stability_limit(self.scene)
