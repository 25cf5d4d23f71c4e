"""Rows of the store on fluids: errors and the time of a frame, by kind of scene; tables of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from rich.console import Console

from softlab.bench.experiments.fluid_truth import laws
from softlab.bench.experiments.fluid_truth.experiment import BESIDE_PEERS, FINDING, LABELS, groups
from softlab.bench.experiments.fluid_truth.scenes import COLUMN, DAM, DROP, TANK, TENSION, TWO, VORTICES
from softlab.bench.experiments.fluids import FRAME
from softlab.bench.measure.costs_timing import SECONDS
from softlab.bench.measure.declaration import Option
from softlab.bench.measure.items import Items
from softlab.bench.measure.tables import columns, print_table
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure, by_configuration, measures
from softlab.model.scene.scene import Scene

NUMBERS: dict[str, dict[str, str]] = {  # kind -> measures and their column titles
    COLUMN: {
        laws.MEAN: "density, mean %", laws.LARGEST: "largest %", laws.HEIGHT: "height %", laws.SPEED: "speed %",
        laws.PRESSURE: "pressure %",
    },
    DAM: {laws.FRONT: "front, worst %", laws.FRONT_LATER: "but the first %", laws.FRONT_MEAN: "mean %"},
    VORTICES: {laws.VISCOSITY: "viscosity / m²/s"},
    DROP: {
        laws.INSIDE: "pressure / Pa", laws.ASPECT: "longest / shortest", laws.DRIFT: "drift", laws.MOMENTUM: "momentum"
    },
    TWO: {laws.LEVEL: "level %", laws.MIXED: "mixed %", laws.MEAN: "density, mean %"},
}  # fmt: skip
NUMBERS[TENSION] = {laws.INSIDE: "pressure / Pa", laws.ASPECT: "longest / shortest"}
NUMBERS[TANK] = {name: text for name, text in NUMBERS[COLUMN].items() if name != laws.PRESSURE}
TITLES = {
    COLUMN: "a column at rest between sides that repeat, 3 s",
    TANK: "water at rest between four walls, 3 s",
    DAM: "Martin and Moyce's dam",
    VORTICES: "Taylor and Green's vortices, viscosity 0",
    DROP: "a drop that is drawn together, 4 s",
    TENSION: "a drop with as much surface tension as cohesion, 4 s",
    TWO: "two fluids that change places, 6 s",
}


@dataclass(frozen=True)
class Judged:
    """One setting.

    `who`: a scheme, or a peer's label; `spacing` [m]; `radius` [m]: of a ball, or a disc, of all particles in that many
    `dimensions`; `coefficient` [N/m]: of its surface tension; `numbers`: measures by name, without missing ones;
    `frame`: wall time [s] of 1/60 s of the scene, None where it was not timed; `suspect`: whether that time is marked;
    `reason`: why there are no numbers.
    """

    kind: str
    machine: str
    backend: str
    who: str
    peer: bool
    substeps: int
    iterations: int
    spacing: float
    particles: int
    dimensions: int
    radius: float
    coefficient: float
    numbers: dict[str, float]
    frame: float | None
    suspect: bool
    reason: str | None

    @property
    def effort(self) -> str:
        """Text of the effort per step, e.g. `8 x 10`; of a peer `its own`."""
        return "its own" if self.peer else f"{self.substeps} x {self.iterations}"


def rows(stored: Iterable[Measure]) -> list[Judged]:
    """Return a row for every setting that was measured: kinds in the order of NUMBERS, schemes, then spacings and
    efforts.
    """
    result = []
    judged = (m for m in stored if str(m.description.get("finding", "")).startswith(FINDING))
    for numbers in by_configuration(judged):
        some = next(iter(numbers.values()))
        fields, kind = some.description, some.description["finding"].removeprefix(FINDING)
        if kind not in NUMBERS:
            continue
        scene = Scene.stored(fields["scene"])
        peer: str | None = fields.get("peer")
        seconds = numbers.get(SECONDS)
        taken = None if seconds is None or seconds.value is None else seconds.value * FRAME / scene.method.dt
        values = {name: m.value for name, m in numbers.items() if name in NUMBERS[kind] and m.value is not None}
        why = None if values else seconds.reason if seconds is not None else "not judged"
        result.append(Judged(
            kind, some.machine, fields["backend"], LABELS.get(peer, peer) if peer else scene.method.scheme, bool(peer),
            scene.method.substeps, scene.method.iterations, scene.fluid_set.spacing, scene.fluid_set.particle_count,
            scene.dimensions, laws.radius_of(scene), max(part.surface_tension for part in scene.fluids.values()), values,
            taken, bool(seconds and "; " in (seconds.reason or "")), why,
        ))  # fmt: skip
    order = list(NUMBERS)
    return sorted(
        result,
        key=lambda r: (
            order.index(r.kind), r.backend, r.peer, r.who, -r.spacing, r.substeps * r.iterations, -r.dimensions, r.particles
        ),
    )  # fmt: skip


@dataclass(frozen=True)
class Tension:
    """Surface tension from the drops of one scheme, with cohesion and surface tension of one coefficient [N/m].

    `sigma` [N/m]: of Laplace's law, pressure = `base_pressure` + (dimensions - 1) sigma / radius; `off`: the largest relative
    deviation of the pressure of one of the `drops` from that line.
    """

    backend: str
    who: str
    dimensions: int
    coefficient: float
    sigma: float
    base_pressure: float
    off: float
    drops: int


def tensions(judged: Iterable[Judged]) -> list[Tension]:
    """Return a row for each scheme with at least three drops, since two always lie on a line."""
    drops: dict[tuple[str, str, int, float], list[Judged]] = {}
    for row in judged:
        if row.kind == TENSION and laws.INSIDE in row.numbers:
            drops.setdefault((row.backend, row.who, row.dimensions, row.coefficient), []).append(row)
    result = []
    for key, group in drops.items():
        if len(group) > 2:
            curvature = np.array([(row.dimensions - 1) / row.radius for row in group])
            inside = np.array([row.numbers[laws.INSIDE] for row in group])
            sigma, base_pressure = np.polyfit(curvature, inside, 1)
            off = float(np.abs((sigma * curvature + base_pressure) / inside - 1).max())
            result.append(Tension(*key, float(sigma), float(base_pressure), off, len(group)))
    return result


def print_truth(console: Console, store: Store, machine: str) -> None:
    """Print a table for each kind of scene that was measured on a machine."""
    judged = rows(measures(store, machine=machine))
    for kind, names in NUMBERS.items():
        group = [row for row in judged if row.kind == kind]
        if not group:
            continue
        lines = []
        for row in group:
            cells = [_cell(row.numbers.get(name), text) for name, text in names.items()]
            frame = "-" if row.frame is None else f"{1e3 * row.frame:.3g}{'?' * row.suspect}"
            lines.append((row.who, row.backend, row.effort, str(row.particles), *cells, frame))
        heads = columns(("by", "on", "effort"), ("particles", *names.values(), "frame / ms"))
        print_table(console, heads, lines, "effort: substeps x iterations; ?: suspect", title=TITLES[kind])
        for line in tensions(group):
            console.print(
                f"{line.who}, {line.backend}, in {line.dimensions} dimensions: {line.sigma:.3g} N/m by Laplace's law, "
                f"{line.sigma / line.coefficient:.2g} of the coefficient; the worst pressure is {100 * line.off:.2g} % off",
                highlight=False, soft_wrap=True,
            )  # fmt: skip
        for row in group:
            if row.reason:
                console.print(f"{row.who}: {row.reason}", highlight=False, soft_wrap=True)


def _cell(value: float | None, text: str) -> str:
    if value is None:
        return "-"
    return f"{100 * value:.2g}" if text.endswith("%") else f"{value:.3g}"


class FluidTruth(Items):
    """Measure the errors of fluids against known solutions."""

    name, command, doing = "fluids: truth", "fluids", "judging and timing: "
    switch = Option("--truth", "Measure errors against known solutions, and the time per frame, instead.", bool)
    options = {"peers": BESIDE_PEERS}
    items = staticmethod(groups)
    show = staticmethod(print_truth)
