"""Which solver is soonest within a hundredth of the answer of its own mesh, at each Young's modulus and size; and the
target that a solver beside the position-based ones is held to: a tenth of their time.

At rest a solver that begins each step where the last one ended stands still where it was let go, however little it does: so
a setting counts there only if in motion it makes MOVES of its way, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan

from rich.console import Console

from bench.experiments.tetrahedral.bars import Bar, bars
from bench.experiments.tetrahedral.promised import WITHIN
from bench.store.database import Store
from bench.store.results import measures
from bench.store.tables import print_table

MOVES = 0.75  # of its way in half a vibration
STIFF = 1e7  # Pa, of the bars that the target is for
TARGET = 0.1  # of the cheapest position-based setting's time, which the best solver is to take at most
AT_REST, IN_MOTION = "at rest", "in motion"


def within(bar: Bar, where: str) -> bool:
    """Whether a setting is within WITHIN of the mesh's own answer, `where` AT_REST or IN_MOTION."""
    if where == AT_REST:
        return abs(bar.solver_error) <= WITHIN and bar.motion_error >= MOVES - 1
    return abs(bar.motion_error) <= WITHIN


def positional(bar: Bar) -> bool:
    """Whether it is position-based."""
    return bar.solver.startswith("xpbd")


@dataclass(frozen=True)
class Decision:
    """Of one mesh of `elements` tetrahedra of `young` [Pa] on a backend: the soonest setting of all within WITHIN `where`,
    and the cheapest position-based one; None where none that was measured is."""

    elements: int
    young: float
    backend: str
    where: str
    best: Bar | None
    rows: Bar | None

    @property
    def share(self) -> float | None:
        """The best one's time over the cheapest position-based one's."""
        return self.best.seconds / self.rows.seconds if self.best and self.rows else None


def decisions(found: Sequence[Bar]) -> list[Decision]:
    """Of all meshes, at rest and in motion; of each the times that are not suspect, if there are such."""
    result = []
    for backend, elements, young in sorted({(b.backend, b.elements, b.young) for b in found}):
        mine = [b for b in found if (b.backend, b.elements, b.young) == (backend, elements, young)]
        for where in (AT_REST, IN_MOTION):
            able = [b for b in mine if within(b, where) and not b.wrong]
            able = sorted([b for b in able if not b.suspect] or able, key=lambda b: b.seconds)
            rows = next((b for b in able if positional(b)), None)
            result.append(Decision(elements, young, backend, where, able[0] if able else None, rows))
    return result


def setting(bar: Bar | None) -> str:
    """`newton 4 x 1, float64: 2.1 ms`."""
    if bar is None:
        return "none measured"
    told = f"{bar.solver} {bar.substeps} x {bar.iterations}, {bar.precision}"
    return f"{told}: {1e3 * bar.seconds:.3g} ms{'?' * bar.suspect}"


def targets(found: Sequence[Bar]) -> list[str]:
    """A sentence for each mesh of the stiffest bars: whether the target is reached there, at rest and in motion."""
    told = []
    for one in decisions(found):
        if one.young != STIFF or one.best is None:
            continue
        start = (
            f"At E {STIFF:.0e} Pa, {one.elements} tetrahedra, {one.backend.upper()}, {one.where}: "
            f"{setting(one.best)}"
        ).replace("e+0", "e")  # fmt: skip
        if one.share is None:
            told.append(
                f"{start}; no position-based setting that was measured gets within {WITHIN:.0%} to compare it with"
            )
        else:
            verdict = "reached" if one.share <= TARGET else "missed"
            told.append(
                f"{start}, {one.share:.2g} of the time of {setting(one.rows)}: the target, {TARGET:g} or less, is {verdict}"
            )
    return told


def print_decisions(console: Console, found: Sequence[Bar]) -> None:
    """Which setting is soonest, a line a mesh; and the target."""
    lines = []
    by_mesh: dict[tuple[str, int, float], dict[str, Decision]] = {}
    for one in decisions(found):
        by_mesh.setdefault((one.backend, one.elements, one.young), {})[one.where] = one
    for (backend, elements, young), both in by_mesh.items():
        cells = [setting(part) for where in (AT_REST, IN_MOTION) for part in (both[where].best, both[where].rows)]
        lines.append((str(elements), f"{young:.0e}", backend, *cells))
    if lines:
        heads = (
            "tetrahedra",
            "E / Pa",
            "backend",
            "rest: soonest",
            "position-based",
            "motion: soonest",
            "position-based",
        )
        print_table(console, heads, lines, f"soonest within {WITHIN:.0%} of the mesh's own answer, a frame of 1/60 s")
        for sentence in targets(found):
            console.print(sentence, highlight=False, soft_wrap=True)


def print_tetrahedra(console: Console, store: Store, machine: str) -> None:
    """A table of what was measured on a machine."""
    found = bars(measures(store, machine=machine))
    rows = [
        (
            str(b.elements), f"{b.young:.0e}", b.solver, f"{b.substeps} x {b.iterations}", b.backend, b.precision,
            f"{1e3 * b.seconds:.3g}{'?' * b.suspect}", "-" if isnan(b.solver_error) else f"{100 * b.solver_error:+.2f}",
            f"{100 * b.motion_error:+.2f}", f"{100 * b.mesh_error:+.1f}",
        )
        for b in found
    ]  # fmt: skip
    heads = (
        "tetrahedra",
        "E / Pa",
        "solver",
        "budget",
        "backend",
        "precision",
        "frame / ms",
        "rest %",
        "motion %",
        "mesh %",
    )
    note = (
        "budget: substeps x iterations of a frame of 1/60 s; rest: sag over the exact one of this mesh; motion: the way "
        "made half a vibration after it was let go, over the exact one; mesh: the exact sag over the continuum's"
    )
    print_table(console, heads, rows, note)
    print_decisions(console, found)
