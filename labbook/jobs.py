"""The jobs at the top of the lab: figures, the lab book, and everything in one go."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from bench.store import DEFAULT_PATH
from labbook.build import build, committed_data
from model.errors import InputError, SoftlabError
from plots.draw import draw_all
from plots.energies import draw_energies

ABLATED = ("lab-curtain", "lab-hammock")  # scenes that `softlab lab` asks what they need


def _prepare(folder: Path) -> None:
    """Make the default results folder; any other folder must be there."""
    if folder.parts and folder.parts[0] == "softlab-results":
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder} cannot be made: {error.strerror or error}") from None


def make_figures(store: Path, folder: Path, trajectory: Path | None = None) -> list[Path]:
    """Draw every figure of the store into `folder`, or (`trajectory`) the energies of a recorded run. Raises InputError."""
    _prepare(folder)
    if trajectory is not None:
        target = folder if folder.suffix else folder / f"{trajectory.stem}-energies.png"
        return [draw_energies(trajectory, target)]
    return draw_all(store, folder, committed_data())


def make_labbook(store: Path, pdf: Path) -> Path:
    """Write the lab book. Before anything was measured here it is written from the committed measurements.

    Raises InputError for a store that was asked for by name and is not there.
    """
    if not store.exists() and store != DEFAULT_PATH:
        raise InputError(f"{store}: no such store; measure first (softlab lab --quick), or give another path")
    _prepare(pdf.parent)
    return build(store if store.exists() else None, pdf)


def whole_lab(console: Console, *, quick: bool, store_path: Path, command: str) -> None:
    """Doctor, sweep, accuracy, stability, hard cases (unless quick), figures, lab book; then a table of what came out.

    What the machine lacks is skipped with its reason. Raises InputError (the store, the folders).
    """
    from app.doctor import examine
    from app.tables import print_findings
    from bench.ablate import ablate
    from bench.ablation_results import print_ablation
    from bench.accuracy import run_accuracy
    from bench.bar import run_bar
    from bench.busy import run_busy
    from bench.convergence import run_convergence
    from bench.crowds import run_crowds
    from bench.findings import run_findings
    from bench.findings_costs import run_costs
    from bench.hard import run_hard
    from bench.hard_results import print_hard
    from bench.projections import run_projections
    from bench.stability import run_stability
    from bench.store import Store
    from bench.sweep import run_sweep
    from bench.tables import print_fastest, print_sweep
    from model.scene import load_scene

    begin = time.perf_counter()
    folder = store_path.parent
    console.rule("doctor")
    print_findings(console, examine())
    with Store(store_path) as store:
        console.rule("sweep: time per step")
        _told(console, run_sweep(store, quick=quick, command=command), print_sweep)
        console.rule("accuracy: speed against error")
        judged = _told(console, run_accuracy(store, quick=quick, command=command))
        if not quick:
            console.rule("findings: the small experiments")
            _told(console, run_findings(store, command=command))
            _told(console, run_costs(store, command=command))
            _told(console, run_convergence(store, command=command))
            _told(console, run_projections(store, command=command))
            _told(console, run_crowds(store, command=command))
            _told(console, run_busy(store, command=command))
            _told(console, run_bar(store, command=command))
        console.rule("stability: where it breaks")
        _told(console, run_stability(store, quick=quick, command=command))
        if not quick:
            console.rule("hard cases: what each integrator makes of them")
            _told(console, run_hard(store, pictures=False, command=command), print_hard)
            console.rule("what the scenes need")
            for name in ABLATED:
                _told(console, ablate(store, load_scene(name), command=command), print_ablation)
    console.rule("figures and lab book")
    figures = folder / "figures"
    made: list[tuple[str, Any]] = [("store", store_path)]
    made += _attempt(console, "figures", lambda: make_figures(store_path, figures) and figures)
    made += _attempt(console, "lab book", lambda: make_labbook(store_path, folder / "labbook.pdf"))
    with Store(store_path, readonly=True) as store:
        print_fastest(console, store, judged.machine)
    table = Table("made", "where", box=None)
    for name, path in made:
        table.add_row(name, str(path))
    console.print(table)
    console.print(f"{time.perf_counter() - begin:.0f} s in all")


def _told(console: Console, summary: Any, show: Callable[[Console, Any], None] | None = None) -> Any:
    """The summary of a measurement, once it is printed. Raises KeyboardInterrupt where that was interrupted."""
    if show is None:
        console.print(str(summary), markup=False, soft_wrap=True)
    else:
        show(console, summary)
    if summary.interrupted:
        raise KeyboardInterrupt
    return summary


def _attempt(console: Console, name: str, job: Callable[[], Any]) -> list[tuple[str, Any]]:
    """The job's result under its name; where the machine cannot do it, the reason is printed and nothing is lost."""
    try:
        return [(name, job())]
    except SoftlabError as error:
        console.print(f"{name}: {error}", markup=False, soft_wrap=True)
        return []
