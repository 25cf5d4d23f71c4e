"""Pictures, exports and descriptions of scenes: one `Presentation` for each family (`SolverFamily.presentation`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from softlab.model.base.components import named
from softlab.model.core.energy import spring_strain
from softlab.model.core.families import family_of
from softlab.model.core.family import Arrays
from softlab.model.core.simulation import Simulation
from softlab.model.core.spare import Counts, counts
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene
from softlab.model.tables.tetrahedra import TetrahedralBody


def largest_strain(scene: Scene, position: np.ndarray, arrays: Arrays) -> float | None:
    """Return the largest absolute strain; 0 if there is none."""
    strain = spring_strain(scene, position, arrays=arrays)
    return float(np.abs(strain).max()) if len(strain) else 0.0


def number_of_particles(scene: Scene) -> str:
    """Return the number of active particles."""
    return str(counts(scene).particles)


def worst_strain(scene: Scene, position: np.ndarray, strain: np.ndarray) -> float:
    """Return the strain of largest absolute value; 0 if there is none."""
    return float(strain[np.argmax(np.abs(strain))]) if len(strain) else 0.0


@dataclass(frozen=True)
class Presentation:
    """Functions that draw, export and describe the scenes of a family.

    - `view(scene, detail, quick, first_colour)`: a view in the current OpenGL context (app/render/views.py).
    - `view_options()`: the words that `--look` takes.
    - `lines(scene)`: [(ends (n, 2), rest length [m])], what is drawn as lines.
    - `strain(scene, position)`: (n,) float64, the strain of those lines, or its substitute.
    - `pieces(scene, position, matrices, inverse_mass)`: the moving parts for a file (app/output/pieces.py).
    - `amounts(scene, counts)`: the numbers of particles, springs and so on, in words; `brief`: the same in a window.
    - `counts(scene)`: the counts besides particles, by name; `size`: the size as the catalogue prints it.
    - `report(simulation, state)`: additional entries of a run's report; `max_strain(scene, position, arrays)`: the
      absolute value of the largest strain, None if it has none; `arrays`: those of the state.
    - `drawn(scene)`: the outputs besides positions that a clip draws, of `normal` and `velocity`.
    - `legend(scene)`: the title of the colours of its strains, None without.
    - `framed(scene, points, bounds, time)`: further points [m] that a picture in space must show at `time` [s], besides
      particles (n, 3) within `bounds` (6,), the lowest and highest coordinates.
    - `materials(scene)`: the bodies whose material the window's keys change, by name.
    - `worst(scene, position, strain)`, `worst_text(worst, fastest)`: the number that the window shows for the state,
      and its text; `quantity`: its name; `fastest`: True if the largest speed is shown with it.
    - `steps_per_frame`: initial steps per frame of the window; None: as many as come nearest to a frame's duration.
    - `particle`: the word for a particle; `particle_name(scene, particle)`: the name of one.
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
    counts: Callable[[Scene], dict[str, Any]] = lambda scene: {}
    size: Callable[[Scene], str] = number_of_particles
    report: Callable[[Simulation, State], dict[str, object]] = lambda simulation, state: {}
    max_strain: Callable[[Scene, np.ndarray, Arrays], float | None] = largest_strain
    drawn: Callable[[Scene], tuple[str, ...]] = lambda scene: ()
    legend: Callable[[Scene], str | None] = lambda scene: None
    framed: Callable[[Scene, np.ndarray, Sequence[float], float], Sequence[np.ndarray]] = lambda *_: ()
    materials: Callable[[Scene], Mapping[str, TetrahedralBody]] = lambda scene: {}
    worst: Callable[[Scene, np.ndarray, np.ndarray], float] = worst_strain
    worst_text: Callable[[float, float], str] = lambda worst, fastest: f"worst strain {worst:+.4g}"
    quantity: str = "Strain"
    fastest: bool = False
    steps_per_frame: int | None = None
    particle: str = "mass"
    particle_name: Callable[[Scene, int], str] = lambda scene, mass: "{}, {}".format(*divmod(mass, scene.grid.columns))
    grips: bool = False
    levels: bool = False


def presentation_of(scene: Scene) -> Presentation:
    """Return the presentation of the scene's family."""
    presentation: Presentation = named(family_of(scene).presentation)
    return presentation
