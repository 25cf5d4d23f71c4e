"""Top-level jobs of the lab: figures, the lab book, the film, and everything in one go."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any, TypeVar

from rich.console import Console
from rich.table import Table

from softlab.bench.measure.experiment import Summary
from softlab.bench.measure.progress import Whole, last_seconds, progress_bar, store_seconds
from softlab.bench.store.database import DEFAULT_PATH, Store
from softlab.labbook.build import build, committed_data, write_book
from softlab.model.base.components import component
from softlab.model.base.errors import InputError, SoftlabError
from softlab.model.base.files import check_target
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.draw import FIGURES, FigureFiles, draw_figures, figures_folder
from softlab.plots.figures.energies import draw_energies, read_energies

ABLATED = ("lab-curtain", "lab-hammock")  # scenes of `softlab lab` for `softlab ablate`
Result = TypeVar("Result")


def _prepare(folder: Path) -> None:
    """Create the default results folder; any other folder must exist."""
    if folder.parts and folder.parts[0] == "softlab-results":
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder} cannot be made: {error.strerror or error}") from None


def make_figures(store: Path, folder: Path, trajectory: Path | None = None) -> list[Path]:
    """Draw every figure of the store into `folder`, or (`trajectory`) the energies of a recorded run. Raises
    InputError.
    """
    if trajectory is not None:
        record = read_energies(trajectory)
        _prepare(folder)  # created only now that there is something to write
        target = folder if folder.suffix else folder / f"{trajectory.stem}-energies.png"
        return [draw_energies(record, target)]
    results = load(store, committed_data())
    _prepare(folder)
    return [path for figure in _drawn(results, folder) for path in figure.paths]


def _drawn(results: Results, folder: Path) -> list[FigureFiles]:
    """Draw the figures of the results, with a progress bar."""
    target = figures_folder(folder)
    with progress_bar(True) as bar:
        task = bar.add_task("figures", total=len(FIGURES))
        return draw_figures(
            results, target, helped=True,
            report=lambda name: bar.update(task, description=f"figure: {name}", advance=1),
        )  # fmt: skip


def make_labbook(store: Path, pdf: Path) -> Path:
    """Write the lab book, from the committed measurements if nothing was measured here.

    Raises InputError for a store that was requested by name and does not exist.
    """
    if not store.exists() and store != DEFAULT_PATH:
        raise InputError(f"{store}: no such store; measure first (softlab lab --quick), or give another path")
    _prepare(pdf.parent)
    return build(store if store.exists() else None, pdf, helped=True)


def make_film(console: Console, store: Path, path: Path, *, quick: bool, voice: bool) -> None:
    """Make the film of the store and the committed measurements, and print its files.

    Raises InputError (a store that was requested by name and does not exist, the file), BackendUnavailable.
    """
    from softlab.app.output.video import CLIP

    canvas, write_film = (component(f"softlab.labbook.film.{part}", "film") for part in ("canvas", "film:write_film"))
    if not store.exists() and store != DEFAULT_PATH:
        raise InputError(f"{store}: no such store; measure first (softlab lab --quick), or give another path")
    _prepare(path.parent)
    check_target(path, (CLIP,), "a film")
    kind = "film --quick" if quick else "film"
    last = last_seconds(kind)
    if last:
        console.print(f"last time this took {sum(last.values()):.0f} s on this machine")
    begin = monotonic()
    results = load(store if store.exists() else None, committed_data())
    film = write_film(results, path, canvas.QUICK if quick else canvas.FULL, voice)
    store_seconds(kind, {"film": monotonic() - begin})
    voiced = f"spoken by {film.voice}" if film.spoken else f"captions alone: no voice ({film.voice})"
    console.print(f"{film.path}: {film.seconds:.0f} s, {film.frames} frames; {voiced}", markup=False, soft_wrap=True)
    console.print(f"{film.captions}: its captions", markup=False, soft_wrap=True)


def whole_lab(console: Console, *, quick: bool, store_path: Path, command: str) -> None:
    """Run the whole lab and print a table of the files.

    The parts are doctor, kernels and references, sweep, accuracy, stability, hard cases (unless quick), figures, lab
    book. Parts that the machine cannot run are skipped with the reason. Raises InputError (the store, the folders).
    """
    from softlab.app.command.doctor import examine
    from softlab.app.command.tables import print_findings
    from softlab.bench.measure.machine import enter_machine
    from softlab.bench.measure.tables import print_fastest

    kind = "lab --quick" if quick else "lab"
    last = last_seconds(kind)
    if last:
        console.print(f"last time this took {sum(last.values()):.0f} s on this machine")
    folder = store_path.parent
    figures, book = folder / "figures", folder / "labbook.pdf"
    files: list[tuple[str, object]] = [("store", store_path)]

    def draw_and_write() -> None:
        results = load(store_path, committed_data())
        drawn = _attempt(console, lambda: _drawn(results, figures))
        if drawn is not None:
            files.append(("figures", figures))
        if _attempt(console, lambda: write_book(results, book, drawn)):
            files.append(("lab book", book))

    with Store(store_path) as store:
        parts: dict[str, Callable[[], object]] = {"doctor": lambda: print_findings(console, examine())}
        parts |= _measurements(console, store, quick, command)
        parts["figures and lab book"] = draw_and_write
        whole = Whole("lab", {name: last.get(name, 1.0) for name in parts})
        for name, job in parts.items():
            console.rule(name)
            with whole.part(name):
                job()
        print_fastest(console, store, enter_machine(store))
    table = Table("made", "where", box=None)
    for name, path in files:
        table.add_row(name, str(path))
    console.print(table)
    store_seconds(kind, whole.seconds)
    slowest = ", ".join(f"{name.partition(':')[0]} {taken:.0f} s" for name, taken in whole.seconds.items())
    console.print(f"{sum(whole.seconds.values()):.0f} s in all: {slowest}", soft_wrap=True)


def _measurements(console: Console, store: Store, quick: bool, command: str) -> dict[str, Callable[[], object]]:
    """Return the measurements of `softlab lab` by name, in order; each prints its results."""
    from softlab.bench.experiments.accuracy.experiment import run_accuracy
    from softlab.bench.experiments.advise.ablate import ablate
    from softlab.bench.experiments.advise.ablation_results import print_ablation
    from softlab.bench.experiments.registry import experiments
    from softlab.bench.experiments.stability.experiment import run_stability
    from softlab.bench.experiments.sweep import run_sweep
    from softlab.bench.measure.compile_ahead import gathering
    from softlab.bench.measure.tables import print_sweep
    from softlab.bench.stress.experiment import run_hard
    from softlab.bench.stress.report import print_hard
    from softlab.model.scene.scene import load_scene

    def job(run: Callable[..., Summary], show: Callable[[Console, Any], None] | None = None) -> Callable[[], None]:
        return lambda: _report(console, run(store, command=command), show)

    def findings() -> None:
        for one in experiments():
            if one.in_lab:
                job(one)()

    def needs() -> None:
        for name in ABLATED:
            _report(console, ablate(store, load_scene(name), command=command), print_ablation)

    # a limit is the scheme's, the same on both backends: a quick run compiles its kernels for one
    stability = partial(run_stability, backends=("cpu",) if quick else None)

    def kernels() -> None:
        with gathering(progress=True):
            for run in (run_sweep, run_accuracy, stability):
                summary = run(store, quick=quick, progress=False, command=command)
                if summary.interrupted:
                    raise KeyboardInterrupt

    parts: dict[str, Callable[[], object]] = {
        "kernels and references: made before anything is measured": kernels,
        "sweep: time per step": job(partial(run_sweep, quick=quick), print_sweep),
        "accuracy: speed against error": job(partial(run_accuracy, quick=quick)),
        "findings: the small experiments": findings,
        "stability: where it breaks": job(partial(stability, quick=quick)),
        "hard cases: what each integrator makes of them": job(partial(run_hard, pictures=False), print_hard),
        "what the scenes need": needs,
    }
    wanted = [name for name in parts if not quick or name.startswith(("kernels", "sweep", "accuracy", "stability"))]
    return {name: parts[name] for name in wanted}


def _report(console: Console, summary: Summary, show: Callable[[Console, Any], None] | None = None) -> None:
    """Print the summary of a measurement. Raises KeyboardInterrupt if the measurement was interrupted."""
    if show is None:
        console.print(str(summary), markup=False, soft_wrap=True)
    else:
        show(console, summary)
    if summary.interrupted:
        raise KeyboardInterrupt


def _attempt(console: Console, job: Callable[[], Result]) -> Result | None:
    """Return the result of the job; if the machine cannot do it, print the reason and return None."""
    try:
        return job()
    except SoftlabError as error:
        console.print(str(error), markup=False, soft_wrap=True)
        return None
