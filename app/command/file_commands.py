"""The commands on files of bodies, one function a sub-command; softlab.py takes them among its own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.command.command_line import errors, out

filing = typer.Typer()


@filing.command(
    epilog="Example: softlab cook blob blob.npz --voxels 20   (your own: softlab cook mesh.obj body.npz --scale 0.001)"
)
def cook(
    source: Annotated[
        str,
        typer.Argument(
            metavar="MESH", help="A closed .obj, .stl or .ply mesh, a shape (blob), or a file of tetrahedra."
        ),
    ],
    target: Annotated[Path, typer.Argument(metavar="BODY.npz", help="The file to write.")],
    edge: Annotated[float | None, typer.Option(help="Edge of a voxel, in metres.")] = None,
    voxels: Annotated[int | None, typer.Option(help="Voxels along the longest side (default 10).")] = None,
    tetrahedra: Annotated[
        str, typer.Option(help="5 a voxel, or 6; conforming: follow the surface (extra: tets).")
    ] = "5",
    unite: Annotated[
        bool, typer.Option("--unite", help="First make one surface of closed pieces that overlap (extra: meshing).")
    ] = False,
    simplify: Annotated[
        int | None, typer.Option(help="Then leave at most so many triangles (extra: meshing).", metavar="N")
    ] = None,
    scale: Annotated[float, typer.Option(help="Metres per unit of the file; a shape times so much.")] = 1.0,
    density: Annotated[float, typer.Option(help="Of the reported mass, in kg/m^3.")] = 1000.0,
) -> None:
    """Cut a mesh into a body of tetrahedra, say how good it is, and write it."""
    from app.command.cook import cook_body

    cook_body(
        source, target, out, errors, edge=edge, voxels=voxels, tetrahedra=tetrahedra, unite=unite, simplify=simplify,
        scale=scale, density=density,
    )  # fmt: skip
