"""Every figure of the lab, drawn from the store: what `softlab figures` calls.

>>> from plots.draw import draw_all
>>> draw_all("softlab-results/results.sqlite", "figures", committed=["labbook/data/h200.csv"])
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from model.errors import InputError
from plots import (
    ablation,
    bandwidth,
    bar,
    convergence,
    crowds,
    findings_damping,
    findings_determinism,
    findings_dissipation,
    findings_exact,
    findings_float32,
    findings_looks,
    graphics,
    hard,
    hard_bodies,
    joules,
    kernels,
    lab_step,
    overtaking,
    peers,
    precisions,
    projections,
    roofline,
    shapes,
    stability,
    thread_scaling,
    time_per_step,
    work_precision,
)
from plots.data import Origin, Results, load
from plots.style import SUFFIXES, Drawing, save, settings

FIGURES: dict[str, Callable[[Results], Drawing | str]] = {
    "time-per-step": time_per_step.draw,
    "thread-scaling": thread_scaling.draw,
    "overtaking": overtaking.draw,
    "graphics": graphics.draw,
    "bandwidth": bandwidth.draw,
    "precisions": precisions.draw,
    "shapes": shapes.draw,
    "work-precision": work_precision.draw,
    "lab-step": lab_step.draw,
    "kernels": kernels.draw,
    "roofline": roofline.draw,
    "joules": joules.draw,
    "peers": peers.draw,
    "stability-stiffness": stability.draw_stiffness,
    "stability-damping": stability.draw_damping,
    "findings-damping": findings_damping.draw,
    "findings-float32": findings_float32.draw,
    "findings-dissipation": findings_dissipation.draw,
    "findings-exact": findings_exact.draw,
    "findings-looks": findings_looks.draw,
    "findings-determinism": findings_determinism.draw,
    "convergence": convergence.draw,
    "ablation": ablation.draw,
    "projections": projections.draw,
    "published": projections.draw_published,
    "crowds": crowds.draw,
    "hard-states": hard.draw_states,
    "hard-verdicts": hard.draw_verdicts,
    "hard-bodies": hard_bodies.draw,
    "hard-body-states": hard_bodies.draw_states,
    "bar-solvers": bar.draw,
    "bar-clusters": bar.draw_clusters,
}
TITLES = {
    "time-per-step": time_per_step.TITLE,
    "thread-scaling": thread_scaling.TITLE,
    "overtaking": overtaking.TITLE,
    "graphics": graphics.TITLE,
    "bandwidth": bandwidth.TITLE,
    "precisions": precisions.TITLE,
    "shapes": shapes.TITLE,
    "work-precision": work_precision.TITLE,
    "lab-step": lab_step.TITLE,
    "kernels": kernels.TITLE,
    "roofline": roofline.TITLE,
    "joules": joules.TITLE,
    "peers": peers.TITLE,
    "stability-stiffness": stability.TITLE_STIFFNESS,
    "stability-damping": stability.TITLE_DAMPING,
    "findings-damping": findings_damping.TITLE,
    "findings-float32": findings_float32.TITLE,
    "findings-dissipation": findings_dissipation.TITLE,
    "findings-exact": findings_exact.TITLE,
    "findings-looks": findings_looks.TITLE,
    "findings-determinism": findings_determinism.TITLE,
    "convergence": convergence.TITLE,
    "ablation": ablation.TITLE,
    "projections": projections.TITLE,
    "published": projections.PUBLISHED_TITLE,
    "crowds": crowds.TITLE,
    "hard-states": hard.STATES_TITLE,
    "hard-verdicts": hard.VERDICTS_TITLE,
    "hard-bodies": hard_bodies.TITLE,
    "hard-body-states": hard_bodies.STATES_TITLE,
    "bar-solvers": bar.TITLE,
    "bar-clusters": bar.CLUSTERS_TITLE,
}


@dataclass(frozen=True)
class FigureFiles:
    """A figure on disk: `paths` (.svg, .png) and `caption`; where the data do not hold it, no paths but a `reason`."""

    name: str
    title: str
    paths: tuple[Path, ...]
    caption: str
    reason: str | None = None


def draw_figures(
    results: Results, out_dir: str | Path, *, footer: bool = True, suffixes: Sequence[str] = SUFFIXES
) -> list[FigureFiles]:
    """Draw what the results hold into an existing folder. `footer`: machine, commit and date on the figure itself;
    `suffixes`: the formats.

    A figure that the data do not hold is left out, with its reason; an older file of its name is removed then, so that
    the folder never mixes two states. Raises InputError where the folder cannot be written.
    """
    folder = Path(out_dir)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; make it first, or give another path for the figures")
    made = []
    with settings():
        for name, draw in FIGURES.items():
            drawing = draw(results)
            if isinstance(drawing, str):
                for suffix in suffixes:
                    _remove(folder / f"{name}.{suffix}")
                made.append(FigureFiles(name, TITLES[name], (), "", drawing))
                continue
            paths = save(drawing, folder, name, footer=footer, suffixes=suffixes)
            made.append(FigureFiles(name, drawing.title, tuple(paths), drawing.caption))
    return made


def draw_all(
    store_or_paths: Origin | Sequence[Origin] | None, out_dir: str | Path, committed: Iterable[str | Path] = ()
) -> list[Path]:
    """Every figure that the results hold, as .svg and .png in `out_dir`; the paths.

    `store_or_paths`: the user's own store(s), open or as paths (.sqlite, .csv), None where there is none; `committed`:
    text exports to draw lightly behind them (or as the main thing where there is no own store). `out_dir` is made where
    its parent exists. Raises InputError.
    """
    results = load(store_or_paths, committed)
    folder = Path(out_dir)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder} cannot be made: {error.strerror or error}; give another path for the figures"
        ) from None
    return [path for figure in draw_figures(results, folder) for path in figure.paths]


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path} cannot be replaced: {error.strerror or error}; check its permissions") from None
