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
from pathlib import Path
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
from softlab.bench.advice_commands import advising
from softlab.bench.commands import measuring
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
def run(
    scene: SceneName,
    backend: Backend = "cpu",
    threads: Threads = "1x",
    precision: Precision = "float32",
    math: Math = "fast",
    kernel: Annotated[
        str | None,
        typer.Option(
            help="Use this kernel. cpu: fused, team, tiled, stages. gpu: one-block, resident, tiles, graph, launch, stages."
        ),
    ] = None,
    steps: Annotated[int | None, typer.Option(help="Number of steps (default 1000).")] = None,
    time: Annotated[
        float | None, typer.Option(help="Simulated time in seconds, rounded to whole steps; instead of --steps.")
    ] = None,
    settings: Settings = None,
    initial: Annotated[Path | None, typer.Option(help="Start from a state file (.npz).")] = None,
    out_file: Annotated[Path | None, typer.Option("--out", help="Write the final state (.npz).")] = None,
    record: Annotated[
        tuple[str, Path] | None, typer.Option(metavar="every=N FILE.npz", help="Write a state every N steps.")
    ] = None,
    render: Annotated[Path | None, typer.Option(help="Draw the final state (.png) or the whole run (.mp4).")] = None,
    export_to: Annotated[
        str | None,
        typer.Option(
            "--export",
            metavar="FILE",
            help="Write meshes of the final state (.ply, .glb), or of every frame: body-{frame:04d}.ply.",
        ),
    ] = None,
    export_every: Annotated[
        float | None, typer.Option(help="Simulated seconds between two frames of --export (default 1/60).")
    ] = None,
    view_options: Annotated[
        list[str] | None,
        typer.Option(
            "--look",
            help="What --render draws. Tetrahedra: skin, mesh or edges, coloured by body, stress or strain. Fluids: "
            "surface, particles or foam, coloured by fluid, speed or density. Repeatable.",
        ),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(metavar="WIDTHxHEIGHT", help="Size of the picture or clip in pixels (default 1280x960)."),
    ] = None,
    fps: Annotated[float | None, typer.Option(help="Frames per second of the clip (default 60).")] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="YAW,PITCH[,SIZE]",
            help="View of a 3-D picture: rotation and elevation in degrees, height of the view in metres.",
        ),
    ] = None,
    hud: Annotated[bool, typer.Option("--hud/--no-hud", help="Draw title and legend over the picture.")] = True,
    allow_unstable: Annotated[
        bool, typer.Option("--allow-unstable", help="Run although method.dt exceeds the stability limit.")
    ] = False,
    allow_incomplete: Annotated[
        bool,
        typer.Option(
            "--allow-incomplete", help="Exit with status 0 although contacts were lost or elements are inverted."
        ),
    ] = False,
    gpus: Annotated[int, typer.Option(help="Number of GPUs that share the scene (with --backend gpu).")] = 1,
    ranks: Annotated[int, typer.Option(help="Number of MPI processes that share the scene (with --backend cpu).")] = 1,
    exchange_every: Annotated[
        int | None,
        typer.Option(help="With --gpus or --ranks: steps between two exchanges of borders (default: automatic)."),
    ] = None,
    link: Annotated[
        str | None,
        typer.Option(
            help="How GPUs exchange data: flags (default) or nccl (also across processes started by mpiexec)."
        ),
    ] = None,
    judge: Annotated[
        bool, typer.Option(help="Compare the final state with a converged reference, if that takes only seconds.")
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Run a scene without a window."""
    from softlab.app.command.pictures import parse_camera
    from softlab.app.command.ranks import among_ranks, start_ranks
    from softlab.app.command.run import Request, run_scene
    from softlab.app.command.run_length import parse_record
    from softlab.bench.experiments.accuracy.judge import judge_run

    request = Request(
        backend, threads, precision, math, kernel, steps, time, initial, out_file,
        parse_record(record[:1]) if record else 0, record[1] if record else None, render, allow_unstable,
        export_to, export_every, gpus, ranks, exchange_every, link, tuple(view_options or ()), allow_incomplete,
        size, fps, hud,
    )  # fmt: skip
    if camera is not None and render is None:
        raise SceneError("--camera", camera, "applies to a picture or a clip; add --render FILE.png")
    wanted = parse_camera(scene_of(scene, settings), camera)
    request, processes = among_ranks(wanted, request)
    if processes:
        raise typer.Exit(start_ranks(processes, sys.argv[1:]))
    with compilations_shown():
        result = run_scene(wanted, request)
    if result.rank != 0:
        return
    for note in result.notes:
        errors.print(note, markup=False)
    if initial:
        result.report["error_reason"] = "started from a file, for which there is no reference"
    elif judge:
        result.report["error"], result.report["error_reason"] = judge_run(result.scene, result.state, result.diverged)
    if as_json:
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


for group in (sweeping, measuring):
    app.registered_commands += group.registered_commands  # here: it is the order of --help
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
