"""Every figure of the lab, drawn from the store, for `softlab figures`.

>>> from softlab.plots.draw import draw_figures, figures_folder
>>> from softlab.plots.core.read import load
>>> draw_figures(load("softlab-results/results.sqlite"), figures_folder("figures"))
"""

from __future__ import annotations

import gc
import multiprocessing
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from softlab.bench.experiments.registry import experiments
from softlab.cpu_backend.core.threads import core_count
from softlab.model.base.errors import InputError
from softlab.plots.core import declared
from softlab.plots.core.data import Results
from softlab.plots.core.files import SUFFIXES, save
from softlab.plots.core.style import DRAWN, settings
from softlab.plots.figures import (  # noqa: F401  their figures enter DRAWN
    ablation,
    bar,
    bar_costs,
    convergence,
    crossover,
    graphics,
    hard,
    hard_bodies,
    joules,
    kernels,
    lab_step,
    peers,
    regimes,
    roofline,
    stability,
    tetrahedra,
    tetrahedra_decides,
    tetrahedra_mesh,
    tetrahedra_total,
    time_per_step,
    work_precision,
)
from softlab.plots.figures.fluids import phases, rest, truth  # noqa: F401
from softlab.plots.figures.scaling import gpus, threads  # noqa: F401
from softlab.plots.findings import determinism, float32  # noqa: F401

MAX_HELPERS = 3  # each takes a second or two to start and to read the results

DRAWN |= {one.name: (one.figure.title, partial(declared.draw, one)) for one in experiments() if one.figure}
FIGURES = {name: draw for name, (_, draw) in sorted(DRAWN.items())}
TITLES = {name: title for name, (title, _) in DRAWN.items()}


@dataclass(frozen=True)
class FigureFiles:
    """A figure on disk.

    `paths` (.svg, .png) and `caption`, which names the machines; if the data are missing, no paths but a `reason`.
    `footer`: height in points of the strip at its top with machine, commit and date.
    """

    name: str
    title: str
    paths: tuple[Path, ...]
    caption: str
    reason: str | None = None
    footer: float = 0.0


Report = Callable[[str], None]


def draw_figures(
    results: Results,
    out_dir: str | Path,
    *,
    footer: bool = True,
    suffixes: Sequence[str] = SUFFIXES,
    helped: bool = False,
    names: Sequence[str] | None = None,
    report: Report = lambda name: None,
) -> list[FigureFiles]:
    """Draw all figures, or those of these `names`, whose data the results have into an existing folder.

    `footer`: print machine, commit and date on the figure itself; `suffixes`: the formats; `helped`: with further
    processes (for programs whose main module may be imported again); `report` is called after each figure. A figure without
    data is left out, with its reason, and an older file of its name is removed, so that the folder never mixes two
    states. Raises InputError if the folder cannot be written.
    """
    folder = Path(out_dir)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; make it first, or give another path for the figures")
    wanted = list(FIGURES if names is None else names)
    files: dict[str, FigureFiles] = {}
    gc.freeze()  # 100 000 measures stay in memory; scanning them for garbage takes as long as half of the figures
    try:
        with settings(), Helpers(results if helped else None, wanted, folder, footer, suffixes) as helpers:
            for name in reversed(wanted):  # from the end backwards, until it reaches the helpers
                files[name] = helpers.result(name) or _draw(results, name, folder, footer, suffixes)
                report(name)
    finally:
        gc.unfreeze()
    return [files[name] for name in wanted]


def _draw(results: Results, name: str, folder: Path, footer: bool, suffixes: Sequence[str]) -> FigureFiles:
    drawing = FIGURES[name](results)
    if isinstance(drawing, str) and results.committed:
        committed = FIGURES[name](results.committed)
        drawing = drawing if isinstance(committed, str) else committed
    if isinstance(drawing, str):
        for suffix in suffixes:
            _remove(folder / f"{name}.{suffix}")
        return FigureFiles(name, TITLES[name], (), "", drawing)
    paths = save(drawing, folder, name, footer=footer, suffixes=suffixes)
    height = drawing.footer_height if footer else 0.0
    return FigureFiles(name, drawing.title, tuple(paths), drawing.short_caption, None, height)


class Helpers:
    """Processes that draw figures from the first one on; a context manager. Without results there are none."""

    def __init__(
        self, results: Results | None, names: Sequence[str], folder: Path, footer: bool, suffixes: Sequence[str]
    ):  # fmt: skip
        self.results, self.names = results, names
        self.folder, self.footer, self.suffixes = folder, footer, suffixes
        self.begun: dict[str, Future[FigureFiles]] = {}

    def __enter__(self) -> Helpers:
        if self.results is None:
            return self
        with suppress(OSError, ImportError):  # on a machine without semaphores one process draws all
            context = multiprocessing.get_context("spawn")  # a fork would inherit locks of threads that it lacks
            helpers = max(1, min(core_count() - 1, MAX_HELPERS))
            self.pool = ProcessPoolExecutor(helpers, context, _begin_helping, (self.results,))
            self.begun = {
                name: self.pool.submit(_help, name, self.folder, self.footer, self.suffixes) for name in self.names
            }
        return self

    def __exit__(self, *_: object) -> None:
        if self.begun:
            self.pool.shutdown(cancel_futures=True)

    def result(self, name: str) -> FigureFiles | None:
        """Return a helper's figure, or None if none had begun it, or it failed; no helper will touch that figure any
        more.
        """
        if name not in self.begun or self.begun[name].cancel():
            return None
        try:
            return self.begun[name].result()
        except Exception:  # the error appears again when the figure is drawn here
            return None


_inputs: list[Results] = []  # input of a helper


def _begin_helping(results: Results) -> None:
    """Initialise a helper's process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the main process
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    gc.freeze()
    _inputs.append(results)


def _help(name: str, folder: Path, footer: bool, suffixes: Sequence[str]) -> FigureFiles:
    with settings():
        return _draw(_inputs[0], name, folder, footer, suffixes)


def figures_folder(out_dir: str | Path) -> Path:
    """Return the folder, created if its parent exists. Raises InputError."""
    folder = Path(out_dir)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder} cannot be made: {error.strerror or error}; give another path for the figures"
        ) from None
    return folder


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path} cannot be replaced: {error.strerror or error}; check its permissions") from None
