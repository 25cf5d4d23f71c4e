"""Pictures and descriptions of worlds, member by member."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softlab.app.families.fluid import speed_report
from softlab.app.families.sheets import SHEET
from softlab.app.presentation import largest_strain, number_of_particles, presentation_of
from softlab.app.render.detail import Detail
from softlab.app.render.view import View
from softlab.model.core.simulation import Simulation
from softlab.model.core.spare import Counts, counts
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene


def _view(scene: Scene, detail: Detail, quick: bool, first_colour: int) -> View:
    from softlab.app.render.world_view import WorldView

    def make(member: Scene, of_member: Detail, colour: int = 0) -> View:
        return presentation_of(member).view(member, of_member, quick, colour)

    return WorldView(scene, make, detail)


def _strain(scene: Scene, position: np.ndarray) -> np.ndarray:
    places = scene.world_set.slices()
    return np.concatenate(
        [presentation_of(one).strain(one, position[places[name]]) for name, one in scene.members.items()]
    )


def _counts(scene: Scene) -> dict[str, object]:
    members = scene.members.items()
    return {
        "members": {
            name: {"particles": one.grid.particle_count} | presentation_of(one).counts(one) for name, one in members
        }
    }


def _drawn(scene: Scene) -> tuple[str, ...]:
    """Return `velocity` if the drawing of a member needs it; members compute their normals themselves."""
    return ("velocity",) if any("velocity" in presentation_of(one).drawn(one) for one in scene.members.values()) else ()


def _amounts(scene: Scene, totals: Counts) -> str:
    members = scene.members.items()
    return "; ".join(f"{name}: {presentation_of(one).amounts(one, counts(one))}" for name, one in members)


def _particle_name(scene: Scene, particle: int) -> str:
    """Return the particle's number in its member."""
    places = scene.world_set.slices().items()
    return next(f"{particle - rows.start} of {name}" for name, rows in places if particle < rows.stop)


def _report(simulation: Simulation, state: State) -> dict[str, object]:
    fluid = simulation.scene.members.get("fluid")
    return speed_report(fluid) if fluid else {}


WORLD = replace(
    SHEET, view=_view, lines=lambda scene: [], strain=_strain, pieces=None,
    counts=_counts, amounts=_amounts, report=_report, size=number_of_particles, max_strain=largest_strain, drawn=_drawn,
    steps_per_frame=None, particle="particle", particle_name=_particle_name,
)  # fmt: skip
