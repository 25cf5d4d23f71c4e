"""Commands that report the contents of the store: figures, lab book, film, the whole lab; used by softlab/cli.py."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from softlab.app.command.command_line import (
    DEFAULT_STORE,
    StorePath,
    compilations_shown,
    note_missing_store,
    out,
    typed,
)

telling = typer.Typer()

Folder = Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Folder for the figures.")]
DEFAULT_FIGURES = Path("softlab-results") / "figures"
DEFAULT_BOOK = Path("softlab-results") / "labbook.pdf"
DEFAULT_FILM = Path("softlab-results") / "film.mp4"


@telling.command(epilog="Example: softlab figures --out figures")
def figures(
    store: StorePath = DEFAULT_STORE,
    folder: Folder = DEFAULT_FIGURES,
    energies: Annotated[
        Path | None, typer.Option(help="Draw only the energies of this trajectory, written by softlab run --record.")
    ] = None,
) -> None:
    """Draw every figure from the measurements of this machine and those that come with the lab."""
    from softlab.labbook.jobs import make_figures

    for path in make_figures(store, folder, energies):
        out.print(str(path), markup=False)


@telling.command(epilog="Example: softlab labbook --out labbook.pdf")
def labbook(
    store: StorePath = DEFAULT_STORE, pdf: Annotated[Path, typer.Option("--out", help="The PDF file.")] = DEFAULT_BOOK
) -> None:
    """Write the lab book (PDF) from the measurements."""
    from softlab.labbook.jobs import make_labbook

    note_missing_store(store, "the lab book")
    out.print(str(make_labbook(store, pdf)), markup=False)


@telling.command(epilog="Example: softlab film --out film.mp4   (captions alone: --no-voice)")
def film(
    store: StorePath = DEFAULT_STORE,
    mp4: Annotated[
        Path, typer.Option("--out", help="The film (.mp4); captions are written beside it (.srt).")
    ] = DEFAULT_FILM,
    voice: Annotated[bool, typer.Option(help="Add a spoken text, if piper or espeak-ng is installed.")] = True,
    quick: Annotated[bool, typer.Option("--quick", help="A film of half a minute in 640 x 360 pixels.")] = False,
) -> None:
    """Make a film of two minutes: both backends side by side, with times and errors."""
    from softlab.labbook.jobs import make_film

    note_missing_store(store, "the film")
    with compilations_shown():
        make_film(out, store, mp4, quick=quick, voice=voice)


@telling.command(epilog="Example: softlab lab --quick")
def lab(
    context: typer.Context,
    quick: Annotated[
        bool, typer.Option("--quick", help="Small sizes: a minute or two on two cores, less once compiled.")
    ] = False,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Run everything: doctor, sweep, accuracy, stability, figures, lab book."""
    from softlab.bench.measure.took import refuse_changes
    from softlab.labbook.jobs import whole_lab

    refuse_changes(context)
    whole_lab(out, quick=quick, store_path=store, command=typed())
