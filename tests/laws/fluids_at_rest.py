"""How still fluids at rest stay, for docs/limits.md: tables and a figure of the committed rows of `softlab fluids --rest`."""

from __future__ import annotations

from pathlib import Path

from bench.experiments.fluid_rest import (
    ACROSS,
    BOX,
    DEPTH,
    DISTURBANCE,
    ENERGY_BOUND,
    SCENES,
    SETTLED,
    SHORT,
    SPACINGS,
    SPEED_BOUND,
    TANK,
    VISCOSITIES,
    WHOLE,
    Still,
    rows,
)
from labbook.build import COMMITTED
from plots.core.data import Results
from plots.core.files import save
from plots.core.read import load
from plots.core.style import Drawing, settings
from plots.figures.fluids.rest import TITLE, draw

DATA = COMMITTED / "amd-epyc-fluids.csv.gz"
PICTURE = Path(__file__).parents[2] / "docs" / "images" / "fluids-rest.png"
COLUMNS = [(spacing, viscosity) for spacing in sorted(SPACINGS, reverse=True) for viscosity in VISCOSITIES]
UNITS = {TANK: (100, "%"), BOX: (1e6, "1e-6")}  # what a speed is told in
INTRODUCTION = " ".join((
    f"Water of 0.4 x {DEPTH:g} x 0.4 m between five planes must lie still: gain no more energy than {ENERGY_BOUND:g} g H",
    f"over the start's, and move at no more than {SPEED_BOUND:.0%} of sqrt(g H) (rms) from {SETTLED} s on. So must a box of",
    f"{ACROSS}³ particles that it fills, whose sides repeat and whose particles begin {DISTURBANCE:g} m off their lattice.",
    f"Without viscosity and with {100 * SPACINGS[0]:g} cm between particles both were watched for {WHOLE} s, all others for",
    f"{SHORT} s, with 10 iterations a substep, in float32. `softlab fluids --rest --peers` measures this; the rows are in",
    f"`labbook/data/{DATA.name}`.",
))  # fmt: skip


def results() -> Results:
    """Return the committed measurements of fluids."""
    return load(None, [DATA])


def drawing() -> Drawing:
    """Return the figure of the committed rows."""
    with settings():
        made = draw(results())
    assert isinstance(made, Drawing), made
    return made


def write_picture() -> None:
    """Write the figure that the page shows."""
    made = drawing()
    with settings():
        save(made, PICTURE.parent, PICTURE.stem, suffixes=("png",))


def lines() -> list[str]:
    """Return the section of the page."""
    found = [row for source in results().sources for row in rows(source.measures)]
    told = ["## Fluids at rest", "", INTRODUCTION, "", f"![{TITLE}](images/{PICTURE.name})", "", drawing().caption, ""]
    for kind in SCENES:
        told += _table(kind, [row for row in found if row.kind == kind])
    wild = [row for row in found if row.speed and not row.rests and not row.peer]
    told += [f"Not at rest: {'; '.join(map(_failure, wild)) or 'none'}.", ""]
    for row in (row for row in found if row.peer and row.speed):
        told.append(
            f"{row.note}, DFSPH with its own steps, in the tank with {100 * row.spacing:g} cm between particles and without "
            f"viscosity: {100 * row.late:.2g} % from {SETTLED} s on ({max(row.speed):g} s watched), "
            f"{100 * row.speed[max(row.speed)]:.2g} % in the last span; its gain of energy is {row.gain:.2g} g H at most."
        )
    return told


def _failure(row: Still) -> str:
    gained = f", {row.gain:.2g} g H gained" if row.gain > ENERGY_BOUND else ""
    return (
        f"{row.who} with {row.substeps} substep{'s' * (row.substeps > 1)} in the {row.kind} at {100 * row.spacing:g} cm and "
        f"{row.viscosity:g} Pa s ({100 * row.late:.2g} %{gained})"
    )


def _table(kind: str, found: list[Still]) -> list[str]:
    """A row for each scheme and number of substeps, a column for each spacing and viscosity."""
    factor, unit = UNITS[kind]
    cells = {(row.who, row.substeps, row.spacing, row.viscosity): row for row in found if row.speed and not row.peer}
    heads = [f"{100 * spacing:g} cm, {viscosity:g} Pa s" for spacing, viscosity in COLUMNS]
    told = [
        f"Largest rms speed from {SETTLED} s on in the {kind}, {unit} of sqrt(g H); bold: not at rest; -: not measured.",
        "",
    ]
    told += ["", f"| scheme, substeps of 1/60 s | {' | '.join(heads)} |", "| --- |" + " --- |" * len(heads)]
    for who, substeps in dict.fromkeys((row.who, row.substeps) for row in found if not row.peer):
        values = []
        for column in COLUMNS:
            row = cells.get((who, substeps, *column))
            text = "-" if row is None else f"{factor * row.late:.2g}"
            values.append(text if row is None or row.rests else f"**{text}**")
        told.append(f"| {who}, {substeps} | {' | '.join(values)} |")
    return [*told, ""]
