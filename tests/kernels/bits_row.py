"""One row of the table of scenes whose states must have the same bits, and what is compared of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

FIELDS = ("position", "velocity", "rotation", "plastic", "inverse_mass", "taps")
COUNTED = ("done", "speed_limited", "not_emitted", "contacts_lost")  # by a solver
PRECISIONS = ("float32", "float64")
LAUNCHED, ONE, BOTH = ("launch", "stages"), (None,), ("stages", "fused")
STAGES = ("stages",)
CPU, SIMULATOR, GPU = "cpu", "simulator", "gpu"


@dataclass(frozen=True, eq=False)
class Row:
    """A scene, and where its bits are compared.

    `steps`: by the place, CPU, SIMULATOR or GPU; it is not run in others. `start`: its first state; `poke`: particle and
    force [N]; `later`: what is set before the last third of the steps, as (live field, path, value) each; `kernels`: of CUDA,
    `more` on a GPU as well; `on_cpu`: of the CPU, the same one if CUDA has one alone; `reads`: what is compared besides the
    state; `without`: a scene whose end must differ, since it lacks what the row is for. `usual`: precisions by place that
    run by default, the others by `--rest`; on a GPU, all that run.
    """

    name: str
    scene: Callable[[], Scene]
    steps: Mapping[str, int]
    start: Callable[[Scene], State] | None = None
    poke: tuple[int, tuple[float, ...]] | None = None
    later: tuple[tuple[str, str, Any], ...] = ()
    kernels: tuple[str | None, ...] = LAUNCHED
    more: tuple[str, ...] = ("graph",)
    on_cpu: tuple[str | None, ...] = BOTH
    reads: tuple[str, ...] = ()
    without: Callable[[], Scene] | None = None
    usual: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def kernels_of(self, place: str) -> tuple[str | None, ...]:
        """The kernels that are compared at a place."""
        if self.kernels == ONE:
            return ONE
        return {CPU: self.on_cpu, SIMULATOR: self.kernels, GPU: (*self.more, *self.kernels)}[place]

    def turn(self, place: str) -> int:
        """Steps until the last third, before which `later` is set."""
        return self.steps[place] - max(1, self.steps[place] // 3)

    def ended(self, place: str, backend: str = "cpu", *, parts: tuple[int, ...] = (), scene: Scene | None = None,
              initial: State | None = None, **options: Any) -> tuple[State, dict[str, list[Any]]]:  # fmt: skip
        """(state after the steps of a place, what the solver counted and what `reads` names), in exact math by default."""
        scene = scene or self.scene()
        begin = initial or (self.start(scene) if self.start else None)
        live = ("poke",) * bool(self.poke) + tuple(name for name, *_ in self.later)
        with open_simulation(
            scene, backend, live=live, initial=begin, allow_unstable=True, **{"math": "exact"} | options
        ) as simulation:
            if self.poke:
                simulation.poke(*self.poke)
            for steps in parts or (self.steps[place],):
                before = min(steps, max(0, self.turn(place) - simulation.step)) if self.later else 0
                simulation.advance(before)
                if simulation.step == self.turn(place) and steps > before:
                    for _, path, value in self.later:
                        simulation.set(path, value)
                simulation.advance(steps - before)
            solver = getattr(simulation, "implicit", simulation)
            numbers = {name: getattr(solver, name) for name in COUNTED if hasattr(solver, name)}
            numbers |= {name: simulation.read(name) for name in self.reads}
            return simulation.state(), {name: np.array(one).tolist() for name, one in numbers.items()}


def different(one: State, other: State) -> list[str]:
    """The arrays of two states whose bits differ."""
    pairs = {name: (getattr(one, name), getattr(other, name)) for name in FIELDS}
    return [name for name, (a, b) in pairs.items() if (a is None) != (b is None) or not np.array_equal(a, b)]


def cases(rows: tuple[Row, ...], place: str) -> list[Any]:
    """(row, precision) of a place."""
    return [
        pytest.param(
            row, precision, id=f"{row.name}-{precision}".replace(" ", "-"),
            marks=[] if place == GPU or precision in row.usual.get(place, ()) else [pytest.mark.rest],
        )
        for row in rows
        if place in row.steps
        for precision in (row.usual.get(GPU, PRECISIONS) if place == GPU else PRECISIONS)
    ]  # fmt: skip
