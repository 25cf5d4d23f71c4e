"""Options of `softlab run`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from softlab.app.command.command_line import Backend, Math, Precision, SceneName, Settings, Threads


@dataclass(frozen=True)
class Request:
    """The options of `softlab run`: exactly one of `steps` and `time` [s]; `export`: a file's name, with {frame} in it for
    a file every `export_every` [s]. `settings`, `camera`, `judge` and `as_json` are the command's alone."""

    backend: Backend = "cpu"
    threads: Threads = "1x"
    precision: Precision = "float32"
    math: Math = "fast"
    kernel: Annotated[
        str | None,
        typer.Option(
            help="Use this kernel. cpu: fused, team, tiled, stages. gpu: one-block, resident, tiles, graph, launch, stages."
        ),
    ] = None
    steps: Annotated[int | None, typer.Option(help="Number of steps (default 1000).")] = None
    time: Annotated[
        float | None, typer.Option(help="Simulated time in seconds, rounded to whole steps; instead of --steps.")
    ] = None
    settings: Settings = None
    initial: Annotated[Path | None, typer.Option(help="Start from a state file (.npz).")] = None
    out: Annotated[Path | None, typer.Option("--out", help="Write the final state (.npz).")] = None
    record: Annotated[
        tuple[str, Path] | None, typer.Option(metavar="every=N FILE.npz", help="Write a state every N steps.")
    ] = None
    render: Annotated[Path | None, typer.Option(help="Draw the final state (.png) or the whole run (.mp4).")] = None
    export: Annotated[
        str | None,
        typer.Option(
            "--export",
            metavar="FILE",
            help="Write meshes of the final state (.ply, .glb), or of every frame: body-{frame:04d}.ply.",
        ),
    ] = None
    export_every: Annotated[
        float | None, typer.Option(help="Simulated seconds between two frames of --export (default 1/60).")
    ] = None
    view_options: Annotated[
        list[str] | None,
        typer.Option(
            "--look",
            help="What --render draws. Tetrahedra: skin, mesh or edges, coloured by body, stress or strain. Fluids: "
            "surface, particles or foam, coloured by fluid, speed or density. Repeatable.",
        ),
    ] = None
    size: Annotated[
        str | None,
        typer.Option(metavar="WIDTHxHEIGHT", help="Size of the picture or clip in pixels (default 1280x960)."),
    ] = None
    fps: Annotated[float | None, typer.Option(help="Frames per second of the clip (default 60).")] = None
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="YAW,PITCH[,SIZE]",
            help="View of a 3-D picture: rotation and elevation in degrees, height of the view in metres.",
        ),
    ] = None
    hud: Annotated[bool, typer.Option("--hud/--no-hud", help="Draw title and legend over the picture.")] = True
    allow_unstable: Annotated[
        bool, typer.Option("--allow-unstable", help="Run although method.dt exceeds the stability limit.")
    ] = False
    allow_incomplete: Annotated[
        bool,
        typer.Option(
            "--allow-incomplete", help="Exit with status 0 although contacts were lost or elements are inverted."
        ),
    ] = False
    gpus: Annotated[int, typer.Option(help="Number of GPUs that share the scene (with --backend gpu).")] = 1
    ranks: Annotated[int, typer.Option(help="Number of MPI processes that share the scene (with --backend cpu).")] = 1
    exchange_every: Annotated[
        int | None,
        typer.Option(help="With --gpus or --ranks: steps between two exchanges of borders (default: automatic)."),
    ] = None
    link: Annotated[
        str | None,
        typer.Option(
            help="How GPUs exchange data: flags (default) or nccl (also across processes started by mpiexec)."
        ),
    ] = None
    judge: Annotated[
        bool, typer.Option(help="Compare the final state with a converged reference, if that takes only seconds.")
    ] = True
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False


@dataclass(frozen=True, kw_only=True)
class RunOptions(Request):
    """The command line of `softlab run`."""

    scene: SceneName
