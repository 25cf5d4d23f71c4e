"""Bodies that the demo adds to its worlds and removes: which copy is next, and where it starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.core.simulation import Simulation
from softlab.model.core.spare import copies_there, counts

GAP = 0.1  # of a body's longest side: between it and what it is dropped on


def next_spare(world: Simulation, last: str | None) -> str:
    """Return the part whose copy is activated next: the first after `last`, in turn, that has inactive copies. Raises
    SceneError if there is none."""
    scene = world.scene
    names = list(scene.bodies)
    with_copies = [name for name, part in scene.bodies.items() if part.spare]
    if not with_copies:
        raise SceneError("spare", 0, f"this scene has no spare bodies; set spare = 5 in [{names[0]}] for five")
    active = copies_there(scene, world.body.inverse_mass)
    waiting = {copy.name for copy in scene.body_set.copies if not active[copy.number]}
    if not waiting:
        name = with_copies[0]
        raise SceneError(
            f"{name}.spare",
            scene.bodies[name].spare,
            "all spare copies are in use; raise `spare`, or press X to remove the selected body",
        )
    begin = names.index(last) + 1 if last in names else 0
    return next(name for name in names[begin:] + names[:begin] if name in waiting)


def drop(world: Simulation, name: str, place: Sequence[float]) -> int:
    """Activate a copy of a part at rest, centred over or under `place` [m] and entirely above it. Returns its number.
    Raises SceneError."""
    part, body_set = world.scene.bodies[name], world.scene.body_set
    first = next(copy for copy in body_set.copies if copy.name == name)
    at_rest = body_set.position[first.particles] - part.places()[0]
    low, high = at_rest.min(axis=0), at_rest.max(axis=0)
    origin = np.asarray(place, dtype=np.float64) - (low + high) / 2
    origin[1] = place[1] - low[1] + GAP * (high - low).max()
    return world.add_body(name, origin.tolist())


def counts_text(world: Simulation) -> str:
    """Return the numbers of active and inactive bodies in words."""
    totals = counts(world.scene, world.body.inverse_mass)
    return f"{totals.bodies} bod{'y' if totals.bodies == 1 else 'ies'}, {totals.waiting} inactive"
