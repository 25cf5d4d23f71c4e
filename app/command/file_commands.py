"""The commands on files of bodies, one function per sub-command; softlab/cli.py adds them to its own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from softlab.app.command.command_line import out
from softlab.app.command.waiting import waiting_shown

filing = typer.Typer()


@filing.command(
    epilog="Example: softlab cook blob blob.npz --voxels 20   (your own: softlab cook mesh.obj body.npz --scale 0.001)"
)
def cook(
    source: Annotated[
        str,
        typer.Argument(
            metavar="MESH",
            help="A closed mesh (.obj, .stl, .ply ...), a built-in shape such as blob, or a file of tetrahedra.",
        ),
    ],
    target: Annotated[Path, typer.Argument(metavar="BODY.npz", help="The file to write.")],
    edge: Annotated[float | None, typer.Option(help="Edge length of a voxel in metres; instead of --voxels.")] = None,
    voxels: Annotated[int | None, typer.Option(help="Voxels along the longest side (default 10).")] = None,
    tetrahedra: Annotated[
        str,
        typer.Option(help="Tetrahedra per voxel, 5 or 6; or conforming: follow the surface (needs the extra tets)."),
    ] = "5",
    unite: Annotated[
        bool,
        typer.Option(
            "--unite", help="Unite overlapping closed pieces into one surface first (needs the extra meshing)."
        ),
    ] = False,
    simplify: Annotated[
        int | None,
        typer.Option(help="Reduce the surface to at most N triangles (needs the extra meshing).", metavar="N"),
    ] = None,
    fill_holes: Annotated[bool, typer.Option("--fill-holes", help="Close the holes of the surface.")] = False,
    scale: Annotated[float, typer.Option(help="Metres per unit of the file; size factor of a shape.")] = 1.0,
    density: Annotated[float, typer.Option(help="Density in kg/m^3, for the reported mass.")] = 1000.0,
) -> None:
    """Cut a mesh into tetrahedra, report their quality, and write them to a file."""
    from softlab.app.command.cook import cook_body
    from softlab.model.assets.cooked import Repair

    cook_body(
        source, target, out, edge=edge, voxels=voxels, tetrahedra=tetrahedra,
        repair=Repair(unite, simplify, fill_holes), scale=scale, density=density,
    )  # fmt: skip


@filing.command(epilog="Example: softlab inspect scan.ply   (CAD, in mm: softlab inspect part.stl --scale 0.001)")
def inspect(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A mesh or a file of tetrahedra of your own.")],
    scale: Annotated[float, typer.Option(help="Metres per unit of the file.")] = 1.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Say what a mesh file holds: size, area, volume, pieces, rims, repairs, its unit, and its possible uses."""
    from softlab.app.command.inspect import inspect_file

    with waiting_shown():
        inspect_file(file, out, scale=scale, as_json=as_json)
