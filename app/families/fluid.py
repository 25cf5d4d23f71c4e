"""How fluids are drawn, exported and described."""

from __future__ import annotations

from math import isnan
from typing import Any

import numpy as np

from softlab.app.output.pieces import Piece
from softlab.app.presentation import Presentation
from softlab.app.render import colours
from softlab.model.fluid.measure import compression
from softlab.model.scene.scene import Scene

ASKED = 30_000  # particles whose densities are computed in passing: a tenth of a second


def _view(scene: Scene, detail: Any, quick: bool, first_colour: int) -> Any:
    from softlab.app.render.fluid.view import FluidView

    return FluidView(scene, detail, shaped=not quick)


def _looks() -> tuple[str, ...]:
    from softlab.app.render.fluid.view import LOOKS

    return LOOKS


def _pieces(
    scene: Scene, position: np.ndarray, matrices: np.ndarray | None, inverse_mass: np.ndarray | None
) -> list[Piece]:
    """Return the particles of each fluid."""
    fluid, flat = scene.fluid_set.fluid, position if position.shape[1] == 3 else np.pad(position, ((0, 0), (0, 1)))
    return [
        Piece(name, np.ascontiguousarray(flat[fluid == number]), colours.BODIES[(number + 1) % len(colours.BODIES)])
        for number, name in enumerate(scene.fluids)
    ]


def _worst(scene: Scene, position: np.ndarray, strain: np.ndarray) -> float:
    """Return the largest density error; NaN where it is not computed."""
    known = len(position) <= ASKED and bool(np.isfinite(position).all())
    return compression(scene, position)[1] if known else np.nan


def _worst_text(worst: float, fastest: float) -> str:
    speed = f"fastest {fastest:.3g} m/s"
    return speed if isnan(worst) else f"largest density error {worst:+.2%}, {speed}"


FLUID = Presentation(
    view=_view,
    looks=_looks,
    strain=lambda scene, position: np.zeros(0),
    pieces=_pieces,
    counts=lambda scene: {"fluids": len(scene.fluids)},
    amounts=lambda scene, told: str(scene.fluid_set),
    brief=lambda scene, told: str(scene.fluid_set),
    worst=_worst,
    worst_text=_worst_text,
    quantity="Fluid",
    fastest=True,
    levels=True,
)
