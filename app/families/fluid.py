"""Pictures, exports and descriptions of fluids."""

from __future__ import annotations

from math import isnan

import numpy as np

from softlab.app.output.pieces import Piece, in_space
from softlab.app.presentation import Presentation
from softlab.app.render import colours
from softlab.app.render.detail import Detail
from softlab.app.render.framing import tank
from softlab.app.render.view import View
from softlab.model.base.components import named
from softlab.model.core.simulation import Simulation
from softlab.model.core.state import State
from softlab.model.fluid.measure import compression, height
from softlab.model.fluid.parameters import speed_limit
from softlab.model.scene.scene import Scene

MAX_MEASURED = 30_000  # particles whose densities are computed in passing: a tenth of a second


def _view(scene: Scene, detail: Detail, quick: bool, first_colour: int) -> View:
    from softlab.app.render.fluid.view import FluidView

    return FluidView(scene, detail, shaped=not quick)


def _pieces(
    scene: Scene, position: np.ndarray, matrices: np.ndarray | None, inverse_mass: np.ndarray | None
) -> list[Piece]:
    """Return the particles of each fluid."""
    fluid, place = scene.fluid_set.fluid, in_space(position)
    return [
        Piece(name, np.ascontiguousarray(place[fluid == number]), colours.BODIES[(number + 1) % len(colours.BODIES)])
        for number, name in enumerate(scene.fluids)
    ]


def _worst(scene: Scene, position: np.ndarray, strain: np.ndarray) -> float:
    """Return the largest density error; NaN where it is not computed."""
    measurable = len(position) <= MAX_MEASURED and bool(np.isfinite(position).all())
    return compression(scene, position)[1] if measurable else np.nan


def _worst_text(worst: float, fastest: float) -> str:
    speed = f"fastest {fastest:.3g} m/s"
    return speed if isnan(worst) else f"largest density error {worst:+.2%}, {speed}"


def speed_report(scene: Scene) -> dict[str, object]:
    """Return `speed_limit` [m/s], the smallest of all fluids."""
    return {"speed_limit": min(speed_limit(scene, part) for part in scene.fluids.values())}


def fluid_report(simulation: Simulation, state: State) -> dict[str, object]:
    """Return how much densities exceed that at rest, the `height` of the highest 1 % of particles above
    the floor of the lowest one at the start, and the limit of speeds."""
    scene, speeds = simulation.scene, speed_report(simulation.scene)
    if not np.isfinite(state.position).all():
        return speeds
    mean, largest = compression(scene, state.position)
    return {"mean_compression": mean, "largest_compression": largest, "height": height(scene, state.position)} | speeds


FLUID = Presentation(
    view=_view,
    view_options=lambda: named("softlab.app.render.fluid.view:VIEW_OPTIONS"),
    strain=lambda scene, position: np.zeros(0),
    pieces=_pieces,
    counts=lambda scene: {"fluids": len(scene.fluids)},
    report=fluid_report,
    amounts=lambda scene, totals: str(scene.fluid_set),
    brief=lambda scene, totals: str(scene.fluid_set),
    worst=_worst,
    worst_text=_worst_text,
    quantity="Fluid",
    fastest=True,
    levels=True,
    max_strain=lambda scene, position, arrays: None,
    drawn=lambda scene: ("velocity",),
    framed=tank,
)
