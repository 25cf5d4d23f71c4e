"""How peers compare with the lab: ratios of times from the store, and the table in the terminal.

A ratio is taken within one run, where both were measured in turn; across runs the machine may have changed.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.peers.registry import OURS, label
from bench.store.database import Store, canonical
from bench.store.results import SPREAD_LIMIT

NO_BREAK = "\N{NO-BREAK SPACE}"  # in the cells of a narrow terminal
DIFFERENCE = "peer_difference"  # the measure: how far a state is from the lab's own in float64, in spacings


@dataclass(frozen=True)
class Ratio:
    """One peer at one size beside the lab. `seconds`, `our_seconds`: medians of a step [s]; `ratio`: the peer's time over
    ours (above 1 we are faster); `low`, `high`: the least and greatest of the repeats taken pair by pair; `threads` None
    on the GPU; `wrong`: its answer failed the check; `suspect`: reasons, of either side; `difference` [spacings] of the
    peer's state from the lab's in float64, None where it was not had."""

    peer: str
    backend: str
    precision: str
    rows: int
    columns: int
    threads: int | None
    seconds: float
    our_seconds: float
    ratio: float
    low: float
    high: float
    wrong: bool
    suspect: tuple[str, ...]
    difference: float | None
    kernel: str
    our_kernel: str

    @property
    def particles(self) -> int:
        return self.rows * self.columns


def ratios(store: Store, machine: str) -> list[Ratio]:
    """Every peer at every size that a machine (a key) timed beside the lab, smallest grids first: of the newest such run.

    A wrong answer of the lab's own leaves no ratio.
    """
    rows = store.query(
        "SELECT run.key, sample.configuration, sample.sources, seconds, steps, suspect "
        "FROM sample JOIN run ON run.key = sample.run WHERE machine = ? AND stage = 'step' "
        "ORDER BY run.started, run.rowid, sample.rowid",
        (machine,),
    )
    descriptions = {key: json.loads(text) for key, text in store.query("SELECT hash, description FROM configuration")}
    notes = {
        (run, key, name): (value, reason)
        for run, key, name, value, reason in store.query(
            "SELECT run, configuration, name, value, reason FROM measure WHERE name IN (?, 'kernel')", (DIFFERENCE,)
        )
    }
    samples: dict[tuple[str, str], list[tuple[float, str | None]]] = {}
    for run, key, _, seconds, steps, suspect in rows:
        if descriptions[key].get("peer") is not None and steps:
            samples.setdefault((run, key), []).append((seconds / steps, suspect))
    ours, others = {}, []
    for run, key in samples:
        description = descriptions[key]
        place = (run, canonical(description["scene"]), description["backend"], description["precision"])
        if description["peer"] == OURS:
            ours[place] = key
        else:
            others.append((place, key))
    newest: dict[tuple[str, ...], Ratio] = {}
    for place, key in others:
        run = place[0]
        if place not in ours or any(_is_wrong(mark) for _, mark in samples[run, ours[place]]):
            continue
        made = _ratio(descriptions[key], samples[run, key], samples[run, ours[place]])
        difference, _ = notes.get((run, key, DIFFERENCE), (None, None))
        kernels = [notes.get((run, which, "kernel"), (None, None))[1] or "auto" for which in (key, ours[place])]
        identity = (*place[1:], made.peer, str(made.threads))
        newest[identity] = Ratio(**made.__dict__ | {
            "difference": difference, "kernel": kernels[0], "our_kernel": kernels[1],
        })  # fmt: skip
    return sorted(newest.values(), key=lambda r: (r.particles, r.rows, r.backend, r.precision))


def _is_wrong(mark: str | None) -> bool:
    return any(reason.startswith(("wrong answer", "state not finite")) for reason in (mark or "").split("; "))


def _ratio(description: dict, theirs: list[tuple[float, str | None]], ours: list[tuple[float, str | None]]) -> Ratio:
    seconds, our_seconds = (np.array([value for value, _ in side]) for side in (theirs, ours))
    pairs = min(len(seconds), len(our_seconds))
    each = seconds[:pairs] / our_seconds[:pairs]
    suspect = list(dict.fromkeys(mark for _, mark in (*theirs, *ours) if mark))
    for name, values in (("its", seconds), ("our", our_seconds)):
        quarter, middle, three_quarters = np.percentile(values, (25, 50, 75))
        if three_quarters - quarter > SPREAD_LIMIT * middle:
            suspect.append(f"{name} spread {(three_quarters - quarter) / middle:.0%}")
    grid = next(t for name, t in description["scene"].items() if t.get("kind", name) == "grid")
    middle, our_middle = float(np.median(seconds)), float(np.median(our_seconds))
    return Ratio(
        description["peer"], description["backend"], description["precision"], grid["rows"], grid["columns"],
        description["threads"], middle, our_middle, middle / our_middle, float(each.min()), float(each.max()),
        any(_is_wrong(mark) for _, mark in theirs), tuple(suspect), None, "auto", "auto",
    )  # fmt: skip


def print_peers(console: Console, store: Store, machine: str) -> None:
    """Nanoseconds per mass and step of the lab, and of each peer with its ratio, a table for each backend and precision."""
    found = ratios(store, machine)
    for backend, precision in dict.fromkeys((r.backend, r.precision) for r in sorted(found, key=lambda r: r.backend)):
        mine = [r for r in found if (r.backend, r.precision) == (backend, precision)]
        names = list(dict.fromkeys(r.peer for r in mine))
        console.print(f"{backend}, {precision}: nanoseconds a mass and step (x: times ours)", highlight=False)
        table = Table("masses", "softlab", *(label(name) for name in names), box=None)
        for shape in dict.fromkeys((r.rows, r.columns) for r in mine):
            here = {r.peer: r for r in mine if (r.rows, r.columns) == shape}
            scale = 1e9 / (shape[0] * shape[1])
            ours = next(iter(here.values())).our_seconds * scale
            table.add_row(
                f"{shape[0]} x {shape[1]}".replace(" ", NO_BREAK),
                f"{ours:.3g}",
                *(_cell(here[name], scale) if name in here else "-" for name in names),
            )
        console.print(table)
    if any(r.suspect for r in found):
        console.print("?: suspect, see docs/method.md;  wrong: the answer differs, so the time wins nothing")


def _cell(ratio: Ratio, scale: float) -> str:
    if ratio.wrong:
        return f"[red]wrong[/red]{NO_BREAK}({ratio.seconds * scale:.3g})"
    return f"{ratio.seconds * scale:.3g}{NO_BREAK}(x{ratio.ratio:.3g}){'?' if ratio.suspect else ''}"
