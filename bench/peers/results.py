"""Comparison of peers with the lab: ratios of times from the store, and the table in the terminal.

A ratio is taken within one run, where both were measured in turn; between runs the machine may have changed.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console
from rich.table import Table

from softlab.bench.peers.bars.tip import BARS
from softlab.bench.peers.lab_xpbd import IMPLICIT
from softlab.bench.peers.registry import OURS, label
from softlab.bench.peers.scenes import SCENES, shape_of, word_of
from softlab.bench.store.database import Store, canonical
from softlab.bench.store.marks import is_wrong
from softlab.bench.store.results import SPREAD_LIMIT

PER_VOXEL, SLENDER = 5, 10  # tetrahedra per voxel; length of a bar of BARS over its width
NO_BREAK = "\N{NO-BREAK SPACE}"  # in the cells of a narrow terminal
# measure: distance of a state from the lab's own in float64, in spacings; for bars that are compared with an exact result
# (bench/peers/bars/tip.py), the relative error of the tip
DIFFERENCE = "peer_difference"
# measure for a peer with a material of its own, whose law is the reason: its difference from the scene's result
PEER_LAW_DIFFERENCE = "peer_law_difference"


@dataclass(frozen=True)
class Ratio:
    """One peer compared with the lab at one size.

    `seconds`, `our_seconds`: median times of a step [s]; `ratio`: the peer's time over ours (above 1 we are faster);
    `low`, `high`: the smallest and largest over pairs of repeats; `threads`: None on the GPU; `wrong`: its state failed
    the check; `suspect`: reasons, of either side; `difference` [spacings]: of the peer's state from the lab's in
    float64, None where it was not measured, `our_difference`: of the lab's own; `scene`: a word of
    bench/peers/scenes.py.
    """

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
    scene: str = "grid"
    our_difference: float | None = None

    @property
    def particles(self) -> int:
        return self.rows * self.columns


def ratios(store: Store, machine: str) -> list[Ratio]:
    """Return every peer at every size that a machine (a key) timed with the lab, smallest grids first.

    From the newest such run. A wrong result of the lab itself leaves no ratio.
    """
    rows = store.query(
        "SELECT run.key, sample.configuration, sample.sources, seconds, steps, suspect "
        "FROM sample JOIN run ON run.key = sample.run WHERE machine = ? AND stage = 'step' "
        "ORDER BY run.started, run.rowid, sample.rowid",
        (machine,),
    )
    descriptions = {key: json.loads(text) for key, text in store.query("SELECT hash, description FROM configuration")}
    distances = {
        (run, key): value
        for run, key, value in store.query(
            "SELECT run, configuration, value FROM measure WHERE name = ?", (DIFFERENCE,)
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
        if place not in ours or any(is_wrong(mark) for _, mark in samples[run, ours[place]]):
            continue
        ratio = _ratio(descriptions[key], samples[run, key], samples[run, ours[place]])
        identity = (*place[1:], ratio.peer, str(ratio.threads))
        newest[identity] = replace(
            ratio, difference=distances.get((run, key)), our_difference=distances.get((run, ours[place])),
            scene=word_of(descriptions[key]["scene"]),
        )  # fmt: skip
    return sorted(newest.values(), key=lambda r: (r.particles, r.rows, r.backend, r.precision))


def _ratio(description: dict, theirs: list[tuple[float, str | None]], ours: list[tuple[float, str | None]]) -> Ratio:
    seconds, our_seconds = (np.array([value for value, _ in side]) for side in (theirs, ours))
    pairs = min(len(seconds), len(our_seconds))
    each = seconds[:pairs] / our_seconds[:pairs]
    suspect = list(dict.fromkeys(mark for _, mark in (*theirs, *ours) if mark))
    for name, values in (("its", seconds), ("our", our_seconds)):
        quarter, middle, three_quarters = np.percentile(values, (25, 50, 75))
        if three_quarters - quarter > SPREAD_LIMIT * middle:
            suspect.append(f"{name} spread {(three_quarters - quarter) / middle:.0%}")
    middle, our_middle = float(np.median(seconds)), float(np.median(our_seconds))
    return Ratio(
        description["peer"], description["backend"], description["precision"], *shape_of(description["scene"]),
        description["threads"], middle, our_middle, middle / our_middle, float(each.min()), float(each.max()),
        any(is_wrong(mark) for _, mark in theirs), tuple(suspect), None,
    )  # fmt: skip


def print_peers(console: Console, store: Store, machine: str) -> None:
    """Print nanoseconds per mass and step of the lab and of each peer with its ratio.

    A table for each scene, backend and precision; for peers that approach the scene's method with the distance from it.
    """
    entries, laws = ratios(store, machine), {}
    order = list(SCENES)
    kinds = {
        (order.index(r.scene) if r.scene in order else len(order), r.scene, r.backend, r.precision) for r in entries
    }
    for _, scene, backend, precision in sorted(kinds):
        group = [r for r in entries if (r.scene, r.backend, r.precision) == (scene, backend, precision)]
        (_print_bars if scene in BARS else _print_table)(console, scene, backend, precision, group)
    for peer, law in store.query(
        "SELECT DISTINCT configuration.description, reason FROM measure JOIN configuration ON "
        "configuration.hash = measure.configuration WHERE name = ?",
        (PEER_LAW_DIFFERENCE,),
    ):
        laws[label(json.loads(peer)["peer"])] = law
    for peer, law in laws.items():
        console.print(f"{peer}: held against {law}", highlight=False, soft_wrap=True)
    if any(r.suspect for r in entries):
        console.print("?: suspect, see docs/method/time.md;  wrong: the answer differs, so the time wins nothing")


def _print_table(console: Console, scene: str, backend: str, precision: str, entries: list[Ratio]) -> None:
    names = list(dict.fromkeys(r.peer for r in entries))
    approached, each = scene in (*IMPLICIT, "rigid"), "body" if scene == "rigid" else "mass"
    what = "" if scene == "grid" else f"{SCENES[scene].text if scene in SCENES else scene}, "
    errors = "; spacings off the lab's answer in float64" if approached else ""
    text = f"{what}{backend}, {precision}: nanoseconds a {each} and step (x: times ours{errors})"
    console.print(text, highlight=False)
    table = Table("bodies" if scene == "rigid" else "masses", "softlab", *(label(name) for name in names), box=None)
    for shape in dict.fromkeys((r.rows, r.columns) for r in entries):
        here = {r.peer: r for r in entries if (r.rows, r.columns) == shape}
        scale = 1e9 / (shape[0] * shape[1])
        first = next(iter(here.values()))
        off = f"{NO_BREAK}({first.our_difference:.1g})" if approached and first.our_difference is not None else ""
        table.add_row(
            f"{shape[0]} x {shape[1]}".replace(" ", NO_BREAK),
            f"{first.our_seconds * scale:.3g}{off}",
            *(_cell(here[name], scale, approached) if name in here else "-" for name in names),
        )
    console.print(table)


def _print_bars(console: Console, scene: str, backend: str, precision: str, entries: list[Ratio]) -> None:
    """Print bars whose exact result is known, a line per peer, fastest first, with error and time."""
    text = f"{SCENES[scene].text}, {backend}, {precision}: milliseconds a frame (x: times ours; off the tip's way)"
    console.print(text, highlight=False)
    shapes = list(dict.fromkeys(r.rows for r in entries))
    heads = [f"{PER_VOXEL * SLENDER * across**3}" for across in shapes]
    table = Table("tetrahedra", *heads, box=None)
    ours = {r.rows: r for r in entries}
    table.add_row(
        f"softlab newton, {BARS[scene][1]} x 1",
        *(_bar_cell(ours[n].our_seconds, ours[n].our_difference) for n in shapes),
    )
    for name in dict.fromkeys(r.peer for r in sorted(entries, key=lambda r: r.seconds)):
        here = {r.rows: r for r in entries if r.peer == name}
        cells = [_bar_cell(here[n].seconds, here[n].difference, here[n]) if n in here else "-" for n in shapes]
        table.add_row(label(name), *cells)
    console.print(table)


def _bar_cell(seconds: float, error: float | None, ratio: Ratio | None = None) -> str:
    off = "" if error is None else f"{100 * error:.2g}{NO_BREAK}%" if error < 10 else "lost"
    times = f"x{ratio.ratio:.3g}; " if ratio is not None else ""
    mark = "" if ratio is None else f"{NO_BREAK}[red]wrong[/red]" if ratio.wrong else "?" if ratio.suspect else ""
    return f"{1e3 * seconds:.3g}{NO_BREAK}({times}{off}){mark}"


def _cell(ratio: Ratio, scale: float, approached: bool) -> str:
    off = f";{NO_BREAK}{ratio.difference:.1g}" if approached and ratio.difference is not None else ""
    if ratio.wrong:
        return f"[red]wrong[/red]{NO_BREAK}({ratio.seconds * scale:.3g}{off})"
    return f"{ratio.seconds * scale:.3g}{NO_BREAK}(x{ratio.ratio:.3g}{off}){'?' if ratio.suspect else ''}"
