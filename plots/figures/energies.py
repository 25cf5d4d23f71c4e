"""Energies over time, from a recorded trajectory (`softlab run SCENE --record every=N traj.npz`).

>>> from softlab.plots.figures.energies import draw_energies
>>> draw_energies("traj.npz", "energies.png")
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softlab.model.base.errors import InputError, SceneError
from softlab.model.base.files import read_archive
from softlab.model.core.energy import energies, keeps
from softlab.model.scene.scene import Scene
from softlab.plots.core.colours import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE
from softlab.plots.core.files import save
from softlab.plots.core.style import Drawing, legend_below, new_figure, settings

ARRAYS = {"time": 1, "step": 1, "position": 3, "velocity": 3}  # array of a trajectory -> dimensions
CURVES = (
    ("total", "total", BLACK, "-"),
    ("kinetic", "kinetic", ORANGE, "-"),
    ("spring", "in the springs", BLUE, "--"),
    ("gravity", "in gravity (0 at the start's top row)", GREEN, "-."),
    ("conserved", "2 x kinetic + potential, which the step {keeps}", PURPLE, ":"),
)


@dataclass(frozen=True)
class EnergyRecord:
    """Energies over a trajectory of `scene`, (frames,) float64: `time` [s], all others [J]; see model/core/energy.py."""

    scene: Scene
    time: np.ndarray
    kinetic: np.ndarray
    spring: np.ndarray
    gravity: np.ndarray
    total: np.ndarray
    conserved: np.ndarray


def read_energies(trajectory: str | Path) -> EnergyRecord:
    """Return the energies of every frame of a recorded trajectory. Raises InputError for any other file."""
    path = Path(trajectory)
    archive = read_archive(path, "energies are drawn of a .npz that softlab run --record every=N FILE.npz wrote")
    missing = [name for name in (*ARRAYS, "scene") if name not in archive]
    if missing:
        raise InputError(f"{path} lacks {', '.join(missing)}; record it with softlab run --record every=N")
    arrays = {name: archive[name] for name in ARRAYS}
    try:
        scene = Scene(json.loads(str(archive["scene"])))
    except (ValueError, TypeError, RecursionError, SceneError) as error:
        raise InputError(f"{path}: its scene cannot be read ({error}); record it again") from None
    for name, dimensions in ARRAYS.items():
        if arrays[name].ndim != dimensions or arrays[name].dtype.kind not in "fiu":
            raise InputError(f"{path}: {name} must be numbers along {dimensions} axes; record it again")
    frames, masses = len(arrays["time"]), scene.grid.particle_count
    for name in ("position", "velocity"):
        wanted = (frames, masses, scene.dimensions)
        if arrays[name].shape != wanted:
            raise InputError(f"{path}: {name} has shape {arrays[name].shape}, not {wanted}; record it again")
    if not frames:
        raise InputError(f"{path} holds no frame; record with a smaller every=N")
    with np.errstate(all="ignore"):
        records = [energies(scene, p, v) for p, v in zip(arrays["position"], arrays["velocity"], strict=True)]
    columns = {name: np.array([one[name] for one in records]) for name, *_ in CURVES}
    if not all(np.isfinite(values).all() for values in (arrays["time"], *columns.values())):
        raise InputError(f"{path}: times or energies are not finite; record a run that does not diverge")
    return EnergyRecord(scene, arrays["time"].astype(float), **columns)


def energy_drawing(record: EnergyRecord) -> Drawing:
    """Return the figure of a trajectory's energies; make and save it inside `settings()`."""
    figure, (ax,) = new_figure()
    largest = max(np.abs(getattr(record, name)).max() for name, *_ in CURVES)
    for name, label, colour, line in CURVES:
        values = getattr(record, name)
        if name == "conserved" and np.allclose(values, record.total, rtol=1e-12, atol=0):
            continue  # equal to the total, whose curve would hide it
        if name in ("spring", "gravity") and np.abs(values).max() <= 1e-12 * largest:
            continue
        marker = "o" if len(record.time) == 1 else None
        ax.plot(record.time, values, line, color=colour, label=label.format(keeps=keeps(record.scene)), marker=marker)
    ax.axhline(0, color=GREY, linewidth=0.8, zorder=1)
    ax.set_xlabel("time / s")
    ax.set_ylabel("energy / J")
    legend_below(figure, [ax], columns=3)
    grid, method = record.scene.grid, record.scene.method
    caption = (
        f"Energies over time of {record.scene.title}: {grid.rows} x {grid.columns} masses, {method.integrator}, "
        f"dt {method.dt:g} s, {len(record.time)} frames."
    )
    return Drawing(figure, caption, title="Energies over time")


def draw_energies(trajectory: str | Path | EnergyRecord, out: str | Path) -> Path:
    """Draw the energies of a trajectory, or of a record, to `out` (.png, .svg or .pdf, in an existing folder).

    Raises InputError.
    """
    path = Path(out)
    if path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise InputError(f"{path}: a figure is a .png, .svg or .pdf file; name it so")
    if not path.parent.is_dir():
        raise InputError(f"{path.parent}: no such folder; make it first, or give another path")
    record = trajectory if isinstance(trajectory, EnergyRecord) else read_energies(trajectory)
    with settings():
        return save(energy_drawing(record), path.parent, path.stem, suffixes=(path.suffix[1:],))[0]
