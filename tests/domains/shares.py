"""How a scene is run in shares on several CPU ranks, and by one; threads stand in for the ranks' processes."""

from __future__ import annotations

from typing import Any

from softlab.app.driver import open_simulation
from softlab.cpu_backend.domains.in_threads import run_in_threads
from softlab.cpu_backend.domains.ranks import on_ranks
from softlab.model.core.options import Options
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene


def alone(scene: Scene, steps: int, **options: Any) -> State:
    with open_simulation(scene, threads=1, math="exact", **options) as simulation:
        simulation.advance(steps)
        return simulation.state()


def shared(scene: Scene, count: int, steps: int, every: int | None = None, **options: Any) -> list[State]:
    """What each rank gathered; half-way it goes on from its state."""

    def program(ranks: Any) -> State:
        with on_ranks(scene, Options(math="exact", **options), ranks, 1, every) as simulation:
            simulation.advance(steps // 2)
            simulation.load(simulation.state())
            simulation.advance(steps - steps // 2)
            return simulation.state()

    return run_in_threads(count, program, patience=60)


def same(found: State, wanted: State) -> bool:
    """To the bit."""
    for name in ("position", "velocity", "inverse_mass", "rotation", "plastic"):
        one, other = getattr(found, name), getattr(wanted, name)
        if (one is None) != (other is None) or (one is not None and one.tobytes() != other.tobytes()):
            return False
    return (found.step, found.time) == (wanted.step, wanted.time)
