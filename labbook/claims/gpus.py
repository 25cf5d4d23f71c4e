"""Claims of the lab book on several GPUs (`softlab sweep --gpus`); rules in labbook/claims/claim.py."""

from __future__ import annotations

from collections.abc import Sequence

from softlab.bench.experiments.scaling.experiment import speedups, weak_efficiencies
from softlab.bench.measure import words
from softlab.bench.measure.case_timing import Row
from softlab.labbook.claims.claim import Claim, Claims
from softlab.plots.core.data import Results, needed
from softlab.plots.figures.scaling.gpus import masses, on_several_gpus

CLAIMS = Claims()
USUAL = "flags"  # the default link
Speedups = Sequence[tuple[Row, float, float | None]]


def _ratio(value: float) -> str:
    return f"{words.number(value)}{words.SPACE}times"


def _of_sheets(rows: Speedups, sheet: str, link: str) -> list[tuple[Row, float, float | None]]:
    return [one for one in rows if one[0].sheet == sheet and one[0].link == link]


@CLAIMS.add("gpus-strong", "A grid on several GPUs was not timed.")
def strong(results: Results) -> Claim:
    """Strong scaling: speed-up over one GPU with one sheet for all."""
    source, measured = on_several_gpus(results)[0]
    ratios = speedups(measured)
    grids, cloths = needed(_of_sheets(ratios, "grid", USUAL)), _of_sheets(ratios, "xpbd", USUAL)
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


@CLAIMS.add("gpus-most", "The rate of several GPUs was not timed.")
def most(results: Results) -> Claim:
    """Rate of the largest grid on the machine with most GPUs, and the speed-up over one of them."""
    source, measured = max(on_several_gpus(results), key=lambda one: max(p.gpus for p in one[1]))
    ratios = needed(_of_sheets(speedups(measured), "grid", USUAL))
    size = max(masses(p) for p, _, _ in ratios)
    here = [(p, faster) for p, faster, _ in ratios if masses(p) == size]
    parts = [
        f"{p.gpus} reach {words.number(p.rate / 1e9)} billion masses a second, {_ratio(faster)} one"
        for p, faster in here
    ]
    numbers = {f"{p.gpus}": faster for p, faster in here}
    return Claim(f"On {source.gpu}{source.bracket}, with {words.masses(size)}, {words.listed(parts)}.", numbers, True)


@CLAIMS.add("gpus-weak", "A grid for each of several GPUs was not timed.")
def weak(results: Results) -> Claim:
    """Weak scaling: one grid for each GPU."""
    _, measured = on_several_gpus(results)[0]
    efficiency = weak_efficiencies(measured)
    rates = [(p, efficiency[id(p)]) for p in measured if id(p) in efficiency and p.link == USUAL and p.sheet == "grid"]
    numbers = needed({f"{p.rows} {p.gpus}": value for p, value in rates})
    parts = [
        f"with {words.masses(masses(p) // p.gpus)} on each, each of {p.gpus} reaches {words.number(100 * rate)}{words.SPACE}%"
        for p, rate in rates
    ]
    text = f"With one grid per GPU (weak scaling), {words.listed(parts)} of the rate of one alone."
    return Claim(text, numbers, min(numbers.values()) > 0.9)


@CLAIMS.add("gpus-links", "NCCL was not timed.")
def links(results: Results) -> Claim:
    """Speed-up with NCCL, from the smallest to the largest grid of each."""
    _, measured = on_several_gpus(results)[0]
    ratios = needed(_of_sheets(speedups(measured), "grid", "nccl"))
    ends = ratios[:: max(1, len(ratios) - 1)]
    numbers = {f"nccl {p.rows} {p.gpus}": faster for p, faster, _ in ends}
    span = " to ".join(words.number(faster) for _, faster, _ in ends)
    exchanges = "If Python starts each exchange, by NCCL, the speed-up is"
    return Claim(f"{exchanges} {span}{words.SPACE}times, from the smallest grid to the largest.", numbers, True)


@CLAIMS.add("gpus-bits", "No state of several GPUs was compared with that of one.")
def bits(results: Results) -> Claim:
    """Comparison of states with one GPU's."""
    _, measured = on_several_gpus(results)[0]
    off = needed([p.difference for p in measured if p.gpus > 1 and p.difference is not None])
    same = f"{words.things(sum(d == 0 for d in off), 'sheet')} of {len(off)}"
    numbers = {"compared": len(off), "largest": max(off)}
    return Claim(f"In exact math, {same} that were compared had the bits of one GPU.", numbers, max(off) == 0)


@CLAIMS.add("gpus-energy", "The energy of several GPUs was not measured.")
def energy(results: Results) -> Claim:
    """Energy per step of all GPUs over that of one GPU with the same grid."""
    counted = [p for p in on_several_gpus(results)[0][1] if p.sheet == "grid" and p.rows == p.columns and p.joules]
    alone = {p.rows: p.joules for p in counted if p.gpus == 1}
    more = [p for p in counted if p.gpus > 1 and p.link == USUAL and p.rows in alone]
    numbers = needed({f"{p.rows} {p.gpus}": p.joules / alone[p.rows] for p in more})
    span = " to ".join(dict.fromkeys(words.number(value) for value in (min(numbers.values()), max(numbers.values()))))
    return Claim(f"All of them together take {span} times the energy of one GPU for the same step.", numbers, True)


@CLAIMS.add("gpus-model", "The model of several GPUs was not compared with any.")
def model(results: Results) -> Claim:
    """Error of the model."""
    _, measured = on_several_gpus(results)[0]
    off = {p.link: [] for p in measured if p.gpus > 1}  # type: dict[str, list[float]]
    for p, faster, by_model in speedups(measured):
        if by_model is not None:
            off[p.link].append(by_model / faster - 1)
    usual, others = needed(off.pop(USUAL, [])), [value for values in off.values() for value in values]
    numbers = {"usual": max(map(abs, usual)), **({"others": max(map(abs, others))} if others else {})}
    also = f", for the other links by up to {words.percent(numbers['others'])}" if others else ""
    return Claim(f"The model of softlab scale is off by up to {words.percent(numbers['usual'])}{also}.", numbers, True)
