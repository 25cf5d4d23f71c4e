"""Fastest solver within 1 % of the exact result of its own mesh, for each Young's modulus and size, and a target.

The target of a solver that is not position-based is a tenth of the time of the position-based ones. At rest a solver
that begins each step where the last one ended stands still where it was released, however little it does. A setting
therefore counts there only if in motion it makes MOVES of the displacement, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isnan

from rich.console import Console

from softlab.bench.experiments.tetrahedra import MODULI, SECTIONS, SETTINGS, TETRAHEDRA, groups
from softlab.bench.experiments.tetrahedral.bars import Bar, bars
from softlab.bench.experiments.tetrahedral.promised import WITHIN
from softlab.bench.measure.declaration import PRECISION, Option
from softlab.bench.measure.items import Items
from softlab.bench.measure.tables import print_table
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure, measures

MOVES = 0.75  # fraction of the displacement in half a vibration
STIFF = 1e7  # Pa, of the bars that the target applies to
TARGET = 0.1  # largest time of the best solver over that of the cheapest position-based setting
AT_REST, IN_MOTION = "at rest", "in motion"


def within(bar: Bar, where: str) -> bool:
    """True if a setting is within WITHIN of the mesh's exact result, `where` AT_REST or IN_MOTION."""
    if where == AT_REST:
        return abs(bar.solver_error) <= WITHIN and moves(bar)
    return abs(bar.motion_error) <= WITHIN


def moves(bar: Bar) -> bool:
    """True if a setting makes MOVES of the displacement in motion, so that its rest is none of a solver that stands still."""
    return bar.motion_error >= MOVES - 1


def positional(bar: Bar) -> bool:
    """True if the setting is position-based."""
    return bar.solver.startswith("xpbd")


@dataclass(frozen=True)
class Decision:
    """Result for one mesh of `elements` tetrahedra of `young` [Pa] on a backend.

    `best`: the fastest setting within WITHIN `where`; `rows`: the cheapest position-based one; None where none that was
    measured is within it.
    """

    elements: int
    young: float
    backend: str
    where: str
    best: Bar | None
    rows: Bar | None

    @property
    def time_ratio(self) -> float | None:
        """Time of the best setting over that of the cheapest position-based one."""
        return self.best.seconds / self.rows.seconds if self.best and self.rows else None


def decisions(measured: Sequence[Bar]) -> list[Decision]:
    """Return the decisions of all meshes, at rest and in motion, from times that are not suspect if there are any."""
    result = []
    for backend, elements, young in sorted({(b.backend, b.elements, b.young) for b in measured}):
        of_mesh = [b for b in measured if (b.backend, b.elements, b.young) == (backend, elements, young)]
        for where in (AT_REST, IN_MOTION):
            able = [b for b in of_mesh if within(b, where) and not b.wrong]
            able = sorted([b for b in able if not b.suspect] or able, key=lambda b: b.seconds)
            rows = next((b for b in able if positional(b)), None)
            result.append(Decision(elements, young, backend, where, able[0] if able else None, rows))
    return result


def setting(bar: Bar | None) -> str:
    """Return e.g. `newton 4 x 1, float64: 2.1 ms`."""
    if bar is None:
        return "none measured"
    text = f"{bar.solver} {bar.substeps} x {bar.iterations}, {bar.precision}"
    return f"{text}: {1e3 * bar.seconds:.3g} ms{'?' * bar.suspect}"


def targets(measured: Sequence[Bar]) -> list[str]:
    """Return a sentence for each mesh of the stiffest bars: whether the target is reached, at rest and in motion."""
    sentences = []
    for one in decisions(measured):
        if one.young != STIFF or one.best is None:
            continue
        start = (
            f"At E {STIFF:.0e} Pa, {one.elements} tetrahedra, {one.backend.upper()}, {one.where}: "
            f"{setting(one.best)}"
        ).replace("e+0", "e")  # fmt: skip
        if one.time_ratio is None:
            sentences.append(
                f"{start}; no position-based setting that was measured gets within {WITHIN:.0%} to compare it with"
            )
        else:
            verdict = "reached" if one.time_ratio <= TARGET else "missed"
            sentences.append(
                f"{start}, {one.time_ratio:.2g} of the time of {setting(one.rows)}: "
                f"the target, {TARGET:g} or less, is {verdict}"
            )
    return sentences


def print_decisions(console: Console, measured: Sequence[Bar]) -> None:
    """Print the fastest setting of each mesh on a line, and the target."""
    lines = []
    by_mesh: dict[tuple[str, int, float], dict[str, Decision]] = {}
    for one in decisions(measured):
        by_mesh.setdefault((one.backend, one.elements, one.young), {})[one.where] = one
    for (backend, elements, young), both in by_mesh.items():
        cells = [setting(part) for where in (AT_REST, IN_MOTION) for part in (both[where].best, both[where].rows)]
        lines.append((str(elements), f"{young:.0e}", backend, *cells))
    if lines:
        heads = (
            "tetrahedra",
            "E / Pa",
            "backend",
            "rest: fastest",
            "position-based",
            "motion: fastest",
            "position-based",
        )
        print_table(console, heads, lines, f"fastest within {WITHIN:.0%} of the mesh's own answer, a frame of 1/60 s")
        for sentence in targets(measured):
            console.print(sentence, highlight=False, soft_wrap=True)


class Tetrahedra(Items):
    """Measure the solver error and the mesh error of a bar of tetrahedra, and the fastest solver within 1 %."""

    name = command = TETRAHEDRA
    doing = "bar: "
    example = "softlab tetrahedra --quick   (softlab tetrahedra --backend cpu --precision float64)"
    quick_help = "One mesh, few substeps and iterations, fewer repeats: half a minute on two cores."
    in_lab = True
    options = {
        "across": Option(
            "--across", "Only bars of this many voxels across: 1, 2, 4 or 8. Repeatable.", int, SECTIONS, quick=SECTIONS[1:2]
        ),
        "young": Option("--young", "Only bars of this Young's modulus: 1e5, 1e6 or 1e7 Pa. Repeatable.", float, MODULI),
        "solvers": Option(
            "--solver", "Only this solver: xpbd, 'xpbd blocks', vbd, newton or 'newton order 2'. Repeatable.",
            values=tuple(SETTINGS),
        ),
        "precisions": PRECISION,
    }  # fmt: skip
    items = staticmethod(groups)
    table = {
        "tetrahedra": "elements", "E / Pa": lambda bar: f"{bar.young:.0e}", "solver": "solver",
        "budget": lambda bar: f"{bar.substeps} x {bar.iterations}", "backend": "backend", "precision": "precision",
        "frame / ms": lambda bar: f"{1e3 * bar.seconds:.3g}{'?' * bar.suspect}",
        "rest %": lambda bar: "-" if isnan(bar.solver_error) else f"{100 * bar.solver_error:+.2f}",
        "motion %": lambda bar: f"{100 * bar.motion_error:+.2f}", "mesh %": lambda bar: f"{100 * bar.mesh_error:+.1f}",
    }  # fmt: skip
    note = (
        "budget: substeps x iterations of a frame of 1/60 s; rest: sag over the exact one of this mesh; motion: the way "
        "made half a vibration after it was let go, over the exact one; mesh: the exact sag over the continuum's"
    )

    def rows(self, stored: Iterable[Measure], every: bool = False) -> Sequence[Bar]:
        return bars(list(stored))

    def show(self, console: Console, store: Store, machine: str) -> None:
        super().show(console, store, machine)
        print_decisions(console, bars(measures(store, machine=machine)))
