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
UNITS = {TANK: (100, "%"), BOX: (1e6, "1e-6")}  # what a speed is told in
INTRODUCTION = " ".join((
    f"Water of 0.4 x {DEPTH:g} x 0.4 m between five planes must lie still: gain no more energy than {ENERGY_BOUND:g} g H",
    f"over the start's, and move at no more than {100 * SPEED_BOUND:g} % of sqrt(g H) (rms) from {SETTLED} s on. So must a",
    f"box of {ACROSS}³ particles that it fills, whose sides repeat and whose particles begin {1e6 * DISTURBANCE:g} µm off",
    f"their lattice. Without viscosity and with {100 * SPACINGS[0]:g} cm between particles both were watched for {WHOLE} s,",
    f"all others for {SHORT} s, with 10 iterations a substep, in float32. In the box that is mostly rounding: in float64",
    "2.5e-7 of sqrt(g H) is exceeded by no scheme after 1.5 s (tests/public/test_still_water.py). `softlab fluids --rest",
    f"--peers` measures this; the rows are in `labbook/data/{DATA.name}`.",
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
    told = ["## Fluids at rest", "", INTRODUCTION, "", f"![{made.title}](images/{PICTURE.name})", "", made.caption, ""]
    for kind in SCENES:
        told += _table(kind, [row for row in found if row.kind == kind])
    wild = [row for row in found if row.speed and not row.rests and not row.peer]
    told += [f"Not at rest: {'; '.join(map(_failure, wild)) or 'none'}. {_boundary(found)}", ""]
    for row in (row for row in found if row.peer and row.speed):
        speeds = ", ".join(f"{100 * speed:.2g} % at {end:g} s" for end, speed in row.speed.items() if end > SETTLED)
        told += [
            f"{row.note}, DFSPH with its own steps, in the tank with {100 * row.spacing:.3g} cm between particles, without "
            f"viscosity, rms, the largest since the time before: {speeds}; its gain of energy is {row.gain:.2g} g H at most.",
            "",
        ]
    return told[:-1]


def shift(row: Still) -> float:
    """Distance that gravity moves a particle by in a substep [rest distances]."""
    return GRAVITY * (FRAME / row.substeps) ** 2 / row.spacing


def _boundary(found: list[Still]) -> str:
    """Return up to which substep every tank is at rest, and from which on one is not."""
    bare = [row for row in found if row.kind == TANK and row.speed and not row.peer and row.viscosity == 0]
    tanks = [row for row in bare if row.who != "macklin"]
    still, wild = ([shift(row) for row in tanks if row.rests is rests] for rests in (True, False))
    return (
        f"Without viscosity the largest g h² / d at which `averaged` and `divergence-free` rest is {max(still):.2g}, the "
        f"smallest at which they do not is {min(wild):.2g}; a run notes more than {RESTS:g}, and `advise` leaves it out."
    )


def _failure(row: Still) -> str:
    gained = f", {row.gain:.2g} g H gained" if row.gain > ENERGY_BOUND else ""
    return (
        f"{row.who} with {row.substeps} substep{'s' * (row.substeps > 1)} in the {row.kind} at {100 * row.spacing:.3g} cm, "
        f"{row.viscosity:g} Pa s ({100 * row.late:.2g} %{gained})"
    )


def _table(kind: str, found: list[Still]) -> list[str]:
    """A row for each scheme and number of substeps, a column for each spacing and viscosity."""
    factor, unit = UNITS[kind]
    cells = {(row.who, row.substeps, row.spacing, row.viscosity): row for row in found if row.speed and not row.peer}
    heads = [f"{100 * spacing:.3g} cm, {viscosity:g} Pa s" for spacing, viscosity in COLUMNS]
    told = [
        f"Largest rms speed from {SETTLED} s on in the {kind}, {unit} of sqrt(g H); bold: not at rest; -: not measured.",
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
        told.append(f"| {who}, {substeps} | {' | '.join(values)} |")
    return [*told, ""]
