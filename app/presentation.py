"""Pictures, exports and descriptions of the scenes of a family: one entry each, which the family names (`SolverFamily`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from softlab.model.base.components import named
from softlab.model.core.families import family_of
from softlab.model.core.spare import Counts
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene


def no_counts(scene: Scene) -> dict[str, Any]:
    """Return {}."""
    return {}


def no_report(simulation: Any, state: State) -> dict[str, Any]:
    """Return {}."""
    return {}


def worst_strain(scene: Scene, position: np.ndarray, strain: np.ndarray) -> float:
    """Return the strain of largest size; 0 where there is none."""
    return float(strain[np.argmax(np.abs(strain))]) if len(strain) else 0.0


def row_and_column(scene: Scene, particle: int) -> str:
    """Return `row, column` of a mass."""
    row, column = divmod(particle, scene.grid.columns)
    return f"{row}, {column}"


@dataclass(frozen=True)
class Presentation:
    """Functions that draw, export and describe the scenes of a family.

    - `view(scene, detail, quick, first_colour)`: a view in the current OpenGL context (app/render/views.py).
    - `view_options()`: the words that `--look` takes.
    - `lines(scene)`: [(ends (n, 2), rest length [m])], what is drawn as lines.
    - `strain(scene, position)`: (n,) float64, the strain of those lines, or of what replaces them.
    - `pieces(scene, position, matrices, inverse_mass)`: the moving parts for a file (app/output/pieces.py).
    - `amounts(scene, counts)`: the numbers of particles, springs and so on, in words; `brief`: the same in a window.
    - `counts(scene)`: the counts besides particles, by name.
    - `report(simulation, state)`: what the report of a run says besides.
    - `worst(scene, position, strain)`, `worst_text(worst, fastest)`: the number that the window shows of the state, and in
      words; `quantity`: what it is called; `fastest`: True if the largest speed is shown with it.
    - `steps_per_frame`: in a window at first; None: those that come nearest to a frame's time.
    - `particle`: what a particle is called; `particle_name(scene, particle)`: which one it is.
    - `grips`: True if the mouse pulls a whole body instead of a particle.
    - `levels`: True if a legend of levels may be needed.
    """

    view: Callable[[Scene, Any, bool, int], Any]
    strain: Callable[[Scene, np.ndarray], np.ndarray]
    amounts: Callable[[Scene, Counts], str]
    brief: Callable[[Scene, Counts], str]
    lines: Callable[[Scene], list[tuple[np.ndarray, float]]] = lambda scene: []
    pieces: Callable[[Scene, np.ndarray, np.ndarray | None, np.ndarray | None], Any] | None = None
    view_options: Callable[[], tuple[str, ...]] = tuple
    counts: Callable[[Scene], dict[str, Any]] = no_counts
    report: Callable[[Any, State], dict[str, Any]] = no_report
    worst: Callable[[Scene, np.ndarray, np.ndarray], float] = worst_strain
    worst_text: Callable[[float, float], str] = lambda worst, fastest: f"worst strain {worst:+.4g}"
    quantity: str = "Strain"
    fastest: bool = False
    steps_per_frame: int | None = None
    particle: str = "mass"
    particle_name: Callable[[Scene, int], str] = row_and_column
    grips: bool = False
    levels: bool = False


def presentation_of(scene: Scene) -> Presentation:
    """Return the presentation of the scene's family."""
    presentation: Presentation = named(family_of(scene).presentation)
    return presentation
