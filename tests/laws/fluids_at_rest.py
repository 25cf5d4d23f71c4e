"""How still fluids at rest stay, for docs/limits.md: tables and a figure of the committed rows of `softlab fluids --rest`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from softlab.bench.experiments.fluid_rest import (
    ACROSS,
    BOX,
    DEPTH,
    DISTURBANCE,
    ENERGY_BOUND,
    GRAVITY,
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
from softlab.bench.experiments.fluids import FRAME
from softlab.labbook.build import COMMITTED
from softlab.model.core.stability.laws import RESTS
from softlab.plots.core.data import Results
from softlab.plots.core.files import save
from softlab.plots.core.read import load
from softlab.plots.core.style import Drawing, settings
from softlab.plots.figures.fluids.rest import draw

DATA = COMMITTED / "amd-epyc-fluids.csv.gz"
PICTURE = Path(__file__).parents[2] / "docs" / "images" / "fluids-rest.png"
COLUMNS = [(spacing, viscosity) for spacing in sorted(SPACINGS, reverse=True) for viscosity in VISCOSITIES]
UNITS = {TANK: (100, "%"), BOX: (1e6, "1e-6")}  # factor and unit of speeds in a table
INTRODUCTION = " ".join((
    f"Water at rest must stay at rest. In a tank of 0.4 x {DEPTH:g} x 0.4 m between five planes it may gain at most",
    f"{ENERGY_BOUND:g} g H of energy over the initial one, and from {SETTLED} s on its rms speed may be at most",
    f"{100 * SPEED_BOUND:g} % of sqrt(g H). The same bounds hold for a full box of {ACROSS}³ particles with periodic sides,",
    f"in which particles start {1e6 * DISTURBANCE:g} µm off their lattice. Runs take {WHOLE} s without viscosity at",
    f"{100 * SPACINGS[0]:g} cm between particles, and {SHORT} s otherwise, with 10 iterations per substep, in float32.",
    "Speeds in the box are mostly rounding: in float64 no scheme exceeds 2.5e-7 of sqrt(g H) after 1.5 s",
    "(tests/public/test_still_water.py). `softlab fluids --rest --peers` measures this; the rows are in",
    f"`labbook/data/{DATA.name}`.",
))  # fmt: skip


def results() -> Results:
    """Return the committed measurements of fluids."""
    return load(None, [DATA])


def committed() -> list[Still]:
    """Return the committed rows."""
    return [row for source in results().sources for row in rows(source.measures)]


def drawing() -> Drawing:
    """Return the figure of the committed rows, captioned by what is committed alone: not by what the code has become."""
    found = results()
    with settings():
        made = draw(found)
    assert isinstance(made, Drawing), made
    (source,) = found.sources
    where = f"Measured on {source.machine.label} with {source.code}, {source.date}."
    return replace(made, text=f"{made.text} {where}", sources=())


def write_picture() -> None:
    """Write the figure that the page shows."""
    made = drawing()
    with settings():
        save(made, PICTURE.parent, PICTURE.stem, suffixes=("png",))


def lines() -> list[str]:
    """Return the section of the page."""
    made, found = drawing(), committed()
    text = ["## Fluids at rest", "", INTRODUCTION, "", f"![{made.title}](images/{PICTURE.name})", "", made.caption, ""]
    for kind in SCENES:
        text += _table(kind, [row for row in found if row.kind == kind])
    text += [_boundary(found), ""]
    for row in (row for row in found if row.peer and row.speed):
        speeds = ", ".join(f"{100 * speed:.2g} % at {end:g} s" for end, speed in row.speed.items() if end > SETTLED)
        text += [
            f"{row.note}, DFSPH with its own step sizes, in the tank with {100 * row.spacing:.3g} cm between particles, "
            f"without viscosity: rms speed, each value the largest since the one before: {speeds}. Its largest gain "
            f"of energy is {row.gain:.2g} g H.",
            "",
        ]
    return text[:-1]


def shift(row: Still) -> float:
    """Distance that gravity moves a particle by in a substep [rest distances]."""
    return GRAVITY * (FRAME / row.substeps) ** 2 / row.spacing


def _boundary(found: list[Still]) -> str:
    """Return up to which substep every tank is at rest, and from which on one is not."""
    bare = [row for row in found if row.kind == TANK and row.speed and not row.peer and row.viscosity == 0]
    tanks = [row for row in bare if row.who != "macklin"]
    still, wild = ([shift(row) for row in tanks if row.rests is rests] for rests in (True, False))
    return (
        f"Without viscosity `averaged` and `divergence-free` come to rest up to g h² / d = {max(still):.2g}, and not from "
        f"{min(wild):.2g} on. Above {RESTS:g} a run prints a note, and `advise` leaves such settings out."
    )


def _table(kind: str, found: list[Still]) -> list[str]:
    """A row for each scheme and number of substeps, a column for each spacing and viscosity."""
    factor, unit = UNITS[kind]
    cells = {(row.who, row.substeps, row.spacing, row.viscosity): row for row in found if row.speed and not row.peer}
    heads = [f"{100 * spacing:.3g} cm, {viscosity:g} Pa s" for spacing, viscosity in COLUMNS]
    table = [
        f"Largest rms speed from {SETTLED} s on in the {kind}, in {unit} of sqrt(g H). Bold: not at rest. -: not measured.",
        "",
        f"| scheme, substeps of 1/60 s | {' | '.join(heads)} |",
        "| --- |" + " --- |" * len(heads),
    ]
    for who, substeps in dict.fromkeys((row.who, row.substeps) for row in found if not row.peer):
        values = []
        for column in COLUMNS:
            row = cells.get((who, substeps, *column))
            text = "-" if row is None else f"{float(f'{factor * row.late:.2g}'):g}"
            values.append(text if row is None or row.rests else f"**{text}**")
        table.append(f"| {who}, {substeps} | {' | '.join(values)} |")
    return [*table, ""]
