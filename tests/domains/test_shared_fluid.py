"""A fluid in slabs: halos, windows, what is done to it, what cannot be shared (bits: test_shares.py)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from shares import alone, same, shared

from softlab.app.driver import open_simulation
from softlab.cpu_backend.domains import fluid
from softlab.cpu_backend.domains.in_threads import run_in_threads
from softlab.cpu_backend.domains.ranks import on_ranks
from softlab.model.base.errors import Diverged
from softlab.model.core.options import Options
from softlab.model.core.simulation import State
from softlab.model.domains import shared_fluid
from softlab.model.scene.scene import Scene

DAM: dict[
    str, Any
] = {  # in a plane, it runs out and comes back; of the narrowest support, which neighbours nearly fill
    "water": {"kind": "fluid", "dimensions": 2, "size": [1.6, 0.3], "rest_distance": 0.05, "support": 0.06}
    | {"velocity": [1.0, 0.0, 0.0], "maximum_speed": 3.0},
    "floor": {"kind": "plane", "thickness": 0.0},
    "left": {"kind": "plane", "normal": [1.0, 0.0, 0.0], "thickness": 0.0},
    "right": {"kind": "plane", "point": [2.0, 0.0, 0.0], "normal": [-1.0, 0.0, 0.0], "thickness": 0.0},
    "gravity": {},
    "method": {"solver": "pbf", "dt": 0.01, "substeps": 2, "iterations": 1},
}


def dam(**settings: Any) -> Scene:
    return Scene(DAM).replace({name.replace("__", "."): value for name, value in settings.items()})


def test_every_particle_is_owned_once() -> None:
    """And held by more, in each halo."""
    scene = dam(water__size=[0.8, 0.15])

    def program(ranks: Any) -> np.ndarray:
        with on_ranks(scene, Options(), ranks, 1) as simulation:
            return simulation.particle_counts()  # type: ignore[union-attr]

    for held in run_in_threads(3, program, patience=60):
        assert held[:, 0].sum() == scene.fluid_set.particle_count and (held[:, 1] > held[:, 0]).all()


PARTS: dict[str, dict[str, Any]] = {
    "smoothed": {"water__viscosity": 20.0, "water__surface_tension": 0.05, "water__vorticity_confinement": 0.5},
    "averaged": {"method__scheme": "averaged", "method__iterations": 2},
}


@pytest.mark.parametrize(
    "parts, size, steps", [(None, [0.8, 0.15], 10), *((parts, [1.6, 0.3], 200) for parts in PARTS)]
)
def test_a_halo_that_lacks_one_support_is_too_thin(
    monkeypatch: pytest.MonkeyPatch, parts: str | None, size: list[float], steps: int
) -> None:
    """So that what the halo is made of is all needed, and a test that it is enough can fail: the fastest goes a quarter of a
    support in a substep here, which makes up for none, and neighbours at rest are nearly a support apart."""
    scene, whole = dam(water__size=size, **PARTS.get(parts or "", {})), shared_fluid.fluid_halo_of
    monkeypatch.setattr(shared_fluid, "fluid_halo_of", lambda scene: whole(scene) - scene.fluid_set.support)
    assert shared(scene, 2, steps)[0].position.tobytes() != alone(scene, steps).position.tobytes()


def driven(simulation: Any) -> tuple[State, np.ndarray]:
    """What a user may do to a fluid while it moves."""
    with simulation:
        simulation.poke(3, (30.0, 20.0))
        simulation.advance(2)
        simulation.set("gravity.enabled", False)
        simulation.set("method.dt", 0.02)
        simulation.advance(2)
        simulation.rewind()
        simulation.advance(3)
        pressure = simulation.read("pressure")
        kept = simulation.state()
        simulation.advance(1)
        simulation.load(kept)
        simulation.advance(1)
        return simulation.state(), pressure


def test_what_is_done_to_a_fluid_reaches_its_shares(monkeypatch: pytest.MonkeyPatch) -> None:
    """A force on a particle, gravity and the step size, which widens halos; what is put aside and loaded; pressures. Windows
    have no room to spare, so that it is made anew on the way."""
    monkeypatch.setattr(fluid, "SPARE", 1.0)
    scene, live = dam(water__size=[1.0, 0.1]), frozenset({"poke", "gravity", "dt"})
    options = Options(math="exact", live=live)
    wanted, pressure = driven(open_simulation(scene, threads=1, math="exact", live=live))
    for found, told in run_in_threads(2, lambda ranks: driven(on_ranks(scene, options, ranks, 1)), patience=60):
        assert same(found, wanted)
        assert told.tobytes() == pressure.tobytes()


def test_a_window_has_room_for_its_share() -> None:
    """Of 64 columns it holds half and those of the halo, two supports and a half or 3 columns, and what is spare. When
    room is made, what the last substep told stays."""

    def room(ranks: Any) -> int:
        with on_ranks(dam(water__size=[3.2, 0.1]), Options(), ranks, 1) as simulation:
            (window,), room = simulation.windows, simulation.windows[0]._particles
            simulation.advance(1)
            told = simulation._multipliers()
            window._grow(room + 8)
            assert told.any() and np.array_equal(simulation._multipliers(), told)
            return room

    assert max(run_in_threads(2, room, patience=60)) <= fluid.SPARE * 2 * (32 + 3)


def test_they_diverge_where_one_does() -> None:
    """A particle beyond what counts as finite, which makes the cells of all wide: the same first bad step and particle."""

    def told(simulation: Any) -> tuple[int, int]:
        with simulation:
            state = simulation.state()
            state.position[5, 1] = 2 * simulation._bound
            simulation.load(state)
            with pytest.raises(Diverged) as found:
                simulation.advance(2)
                simulation.check()
        return found.value.step, found.value.particle

    scene, options = dam(water__size=[0.8, 0.1]), Options(math="exact")
    one = told(open_simulation(scene, threads=1, math="exact"))
    assert run_in_threads(2, lambda ranks: told(on_ranks(scene, options, ranks, 1)), patience=60) == [one, one]
