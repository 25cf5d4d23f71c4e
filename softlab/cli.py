"""The command line of the soft-body lab: one function per sub-command and nothing else. Commands that measure:
bench/*commands.py; that advise: bench/advice_commands.py; that report the store: labbook/commands.py; on files and
stores: app/command/file_commands.py, bench/store/commands.py."""

from __future__ import annotations

from softlab.app.command.stopping import install_interrupt_handler

install_interrupt_handler()  # what is imported next takes half a second
# ruff: noqa: E402

import json
import sys
from dataclasses import replace
from typing import Annotated

import typer

from softlab.app.command.command_line import (
    Backend,
    Commands,
    Math,
    Precision,
    SceneName,
    Settings,
    Threads,
    compilations_shown,
    errors,
    exit_status,
    out,
    scene_of,
)
from softlab.app.command.file_commands import filing
from softlab.app.command.options_class import with_options
from softlab.app.command.run_options import RunOptions
from softlab.bench.advice_commands import advising
from softlab.bench.declared_commands import add_commands
from softlab.bench.scale_commands import scaling
from softlab.bench.store.commands import keeping
from softlab.bench.sweep_commands import sweeping
from softlab.labbook.commands import telling
from softlab.model.base.errors import SceneError
from softlab.model.domains.launched import launched_ranks

app = typer.Typer(
    cls=Commands,
    help="Simulate soft bodies on CPU threads and on CUDA, and measure how fast and how accurate each run is.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)


def print_version(asked: bool) -> None:
    """Print the version of the lab and its commit, if known (--version)."""
    if asked:
        from importlib.metadata import version

        from softlab.bench.store.versions import code_version

        commit = code_version().split()[0]
        out.print(f"softlab {version('soft-body-lab')}" + (f", commit {commit}" if commit != "-" else ""), markup=False)
        raise typer.Exit


@app.callback()
def softlab(
    version: Annotated[
        bool, typer.Option("--version", callback=print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    allow_dirty: Annotated[
        bool,
        typer.Option(
            "--allow-dirty", help="Measure though files differ from their commit; the runs are marked with +."
        ),
    ] = False,
) -> None:
    """Simulate soft bodies on CPU threads and on CUDA, and measure how fast and how accurate each run is."""


def main() -> None:
    """Run the command line; an error a user can mend is one line on standard error and its exit status."""
    status = exit_status(lambda: app(standalone_mode=False, prog_name="softlab"))
    if launched_ranks() > 1:
        from softlab.app.command.ranks import rank_status

        status = rank_status(status)
    sys.exit(status)


@app.command(epilog="Example: softlab run lab-grid --steps 1000 --set grid.rows=256 --json   (on a GPU: --backend gpu)")
@with_options(RunOptions)
def run(options: RunOptions) -> None:
    """Run a scene without a window."""
    from softlab.app.command.pictures import parse_camera
    from softlab.app.command.ranks import among_ranks, start_ranks
    from softlab.app.command.run import run_scene
    from softlab.bench.experiments.accuracy.judge import judge_run

    if options.camera is not None and options.render is None:
        raise SceneError("--camera", options.camera, "applies to a picture or a clip; add --render FILE.png")
    wanted = parse_camera(scene_of(options.scene, options.settings), options.camera)
    request, processes = among_ranks(wanted, options)
    if processes:
        raise typer.Exit(start_ranks(processes, sys.argv[1:]))
    with compilations_shown():
        result = run_scene(wanted, request)
    if result.rank != 0:
        return
    for note in result.notes:
        errors.print(note, markup=False)
    if options.initial:
        result.report["error_reason"] = "started from a file, for which there is no reference"
    elif options.judge:
        result.report["error"], result.report["error_reason"] = judge_run(result.scene, result.state, result.diverged)
    if options.as_json:
        print(json.dumps(result.report))
    else:
        from softlab.app.command.tables import print_report
        from softlab.model.core.energy import keeps

        print_report(out, result.report, result.written, keeps(result.scene))
    if ended := result.diverged or result.incomplete:
        raise ended


@app.command(epilog="Example: softlab demo lab-grid   (side by side: softlab demo two-worlds two-worlds-moon)")
def demo(
    scenes: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="SCENE",
            help="A name that `softlab scenes` lists, or a .toml file; several are shown side by side (default: lab-grid).",
        ),
    ] = None,
    backend: Backend = "cpu",
    threads: Threads = "1x",
    precision: Precision = "float32",
    math: Math = "fast",
    settings: Settings = None,
    frames: Annotated[int | None, typer.Option(help="Close the window after this many frames.")] = None,
) -> None:
    """Show scenes in a window; key H lists the keys, key A opens the panel with all settings."""
    from softlab.app.window.viewer import run_demo
    from softlab.bench.experiments.accuracy.judge import judge_run

    if frames is not None and frames < 1:
        raise SceneError("--frames", frames, "must be a whole number, at least 1")
    shown = [scene_of(name, settings) for name in scenes or ["lab-grid"]]
    with compilations_shown():
        run_demo(
            shown, backend=backend, threads=threads, precision=precision, math=math, frames=frames, judge=judge_run
        )


app.registered_commands += sweeping.registered_commands  # here: it is the order of --help
add_commands(app)
for group in (advising, telling):
    app.registered_commands += group.registered_commands


@app.command(epilog="Example: softlab scenes")
def scenes(
    fields: Annotated[
        str | None, typer.Option(metavar="KIND", help="List the fields of a table of this kind instead, e.g. wind.")
    ] = None,
) -> None:
    """List the scenes that come with the lab, or (--fields) the fields of a table of a scene file."""
    from softlab.app.command.tables import print_fields, print_scenes

    if fields is not None:
        print_fields(out, fields)
    else:
        print_scenes(out)


@app.command(epilog="Example: softlab plan lab-grid --measure   (softlab plan lab-grid --gpus 4 --set grid.rows=8192)")
def plan(
    scene: SceneName,
    backend: Annotated[str | None, typer.Option(help="Only this backend: cpu or gpu.")] = None,
    precision: Precision = "float32",
    measure: Annotated[
        bool, typer.Option("--measure", help="Time every stage; takes about a second per backend.")
    ] = False,
    gpus: Annotated[int, typer.Option(help="Also print how the scene is shared by this many GPUs.")] = 1,
    exchange_every: Annotated[
        int | None, typer.Option(help="With --gpus: steps between two exchanges of borders.")
    ] = None,
    settings: Settings = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Print the stages of a step with their bytes and operations, the kernel of each backend, and the stability limit."""
    from softlab.app.driver import BACKENDS
    from softlab.app.plan.report import plan_report
    from softlab.app.plan.shared import shared_plan
    from softlab.app.shared import check_asked

    check_asked("gpu", gpus, 1, exchange_every, None)
    wanted = BACKENDS if backend is None else (backend,)
    with compilations_shown():
        report = plan_report(scene_of(scene, settings), precision, wanted, measure)
    if gpus != 1:
        report = replace(report, shared=shared_plan(report.scene, gpus, exchange_every, report.item))
    if as_json:
        print(json.dumps(report.as_dict()))
    else:
        from softlab.app.plan.table import print_plan

        print_plan(out, report)


@app.command(epilog="Example: softlab doctor")
def doctor() -> None:
    """Check what works on this machine, and print how to get what is missing."""
    from softlab.app.command.doctor import examine
    from softlab.app.command.tables import print_findings

    print_findings(out, examine())


for group in (scaling, filing, keeping):
    app.registered_commands += group.registered_commands


if __name__ == "__main__":
    main()
