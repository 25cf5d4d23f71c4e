"""Claims of the lab book on several GPUs (`softlab sweep --gpus`); rules in labbook/claims/claim.py."""

from __future__ import annotations

from collections.abc import Sequence

from softlab.bench.experiments.scaling.experiment import speedups, weak_efficiencies
from softlab.bench.measure import words
from softlab.bench.measure.case_timing import Row
from softlab.labbook.claims.claim import Claim, Claims
from softlab.plots.core.backends import on_backends
from softlab.plots.core.data import Results, Source
from softlab.plots.figures.scaling.gpus import masses, timed_shared

USUAL = "flags"  # the default link
Speedups = Sequence[tuple[Row, float, float | None]]


def _measured(results: Results) -> tuple[Source | None, Sequence[Row]]:
    """Return the first machine that distributed a sheet among GPUs, and its points."""
    chosen = on_backends(results, timed_shared)
    return (chosen[0][1], chosen[0][2]) if chosen else (None, ())


def _ratio(value: float) -> str:
    return f"{words.number(value)}{words.SPACE}times"


def _of_grids(rows: Speedups, link: str) -> list[tuple[Row, float, float | None]]:
    return [one for one in rows if one[0].sheet == "grid" and one[0].link == link]


def strong(results: Results) -> Claim:
    """Strong scaling: speed-up over one GPU with one sheet for all."""
    source, measured = _measured(results)
    ratios = speedups(measured)
    grids, cloths = _of_grids(ratios, USUAL), [one for one in ratios if one[0].sheet == "xpbd" and one[0].link == USUAL]
    if source is None or not grids:
        return Claim("A grid on several GPUs was not timed.")
    numbers = {f"{p.sheet} {p.rows} {p.gpus}": faster for p, faster, _ in [*grids, *cloths]}
    parts = [
        f"{_ratio(faster)}{'' if k else ' as fast'} by {p.gpus} at {words.masses(masses(p))}"
        for k, (p, faster, _) in enumerate(grids)
    ]
    cloth = "".join(
        f"; a cloth of constraints {_ratio(f)} by {p.gpus} at {words.masses(masses(p))}" for p, f, _ in cloths
    )
    one = f"Against one {source.gpu}{source.bracket}, a grid is stepped"
    return Claim(f"{one} {words.listed(parts)}{cloth}.", numbers, True)


def weak(results: Results) -> Claim:
    """Weak scaling: one grid for each GPU."""
    _, measured = _measured(results)
    efficiency = weak_efficiencies(measured)
    rates = [(p, efficiency[id(p)]) for p in measured if id(p) in efficiency and p.link == USUAL and p.sheet == "grid"]
    if not rates:
        return Claim("A grid for each of several GPUs was not timed.")
    numbers = {f"{p.rows} {p.gpus}": value for p, value in rates}
    parts = [
        f"with {words.masses(masses(p) // p.gpus)} on each, each of {p.gpus} reaches {words.number(100 * rate)}{words.SPACE}%"
        for p, rate in rates
    ]
    return Claim(
        f"With one grid per GPU (weak scaling), {words.listed(parts)} of the rate of one alone.",
        numbers,
        min(numbers.values()) > 0.9,
    )


def links(results: Results) -> Claim:
    """Speed-up with NCCL, from the smallest to the largest grid of each."""
    _, measured = _measured(results)
    ratios = _of_grids(speedups(measured), "nccl")
    if not ratios:
        return Claim("NCCL was not timed.")
    ends = ratios[:: max(1, len(ratios) - 1)]
    numbers = {f"nccl {p.rows} {p.gpus}": faster for p, faster, _ in ends}
    span = " to ".join(words.number(faster) for _, faster, _ in ends)
    return Claim(
        f"If Python starts each exchange, by NCCL, the speed-up is {span}{words.SPACE}times, from the smallest grid to the "
        "largest.",
        numbers,
        True,
    )


def bits(results: Results) -> Claim:
    """Comparison of states with one GPU's."""
    _, measured = _measured(results)
    off = [p.difference for p in measured if p.gpus > 1 and p.difference is not None]
    if not off:
        return Claim("No state of several GPUs was compared with that of one.")
    same = f"{words.things(sum(d == 0 for d in off), 'sheet')} of {len(off)}"
    numbers = {"compared": len(off), "largest": max(off)}
    return Claim(f"In exact math, {same} that were compared had the bits of one GPU.", numbers, max(off) == 0)


def energy(results: Results) -> Claim:
    """Energy per step of all GPUs over that of one GPU with the same grid."""
    _, measured = _measured(results)
    alone = {
        p.rows: p.joules for p in measured if p.gpus == 1 and p.sheet == "grid" and p.rows == p.columns and p.joules
    }
    ratios = [
        (p, p.joules / (alone[p.rows] or 1))
        for p in measured
        if p.gpus > 1 and p.joules and p.link == USUAL and p.sheet == "grid" and p.rows == p.columns and p.rows in alone
    ]
    if not ratios:
        return Claim("The energy of several GPUs was not measured.")
    numbers = {f"{p.rows} {p.gpus}": value for p, value in ratios}
    span = " to ".join(dict.fromkeys(words.number(value) for value in (min(numbers.values()), max(numbers.values()))))
    return Claim(f"All of them together take {span} times the energy of one GPU for the same step.", numbers, True)


def model(results: Results) -> Claim:
    """Error of the model."""
    _, measured = _measured(results)
    off = {p.link: [] for p in measured if p.gpus > 1}  # type: dict[str, list[float]]
    for p, faster, by_model in speedups(measured):
        if by_model is not None:
            off[p.link].append(by_model / faster - 1)
    usual, others = off.pop(USUAL, []), [value for values in off.values() for value in values]
    if not usual:
        return Claim("The model of several GPUs was not compared with any.")
    numbers = {"usual": max(map(abs, usual)), **({"others": max(map(abs, others))} if others else {})}
    also = f", for the other links by up to {words.percent(numbers['others'])}" if others else ""
    return Claim(f"The model of softlab scale is off by up to {words.percent(numbers['usual'])}{also}.", numbers, True)


CLAIMS: Claims = {
    "gpus-strong": strong, "gpus-weak": weak, "gpus-links": links, "gpus-bits": bits, "gpus-energy": energy,
    "gpus-model": model,
}  # fmt: skip
