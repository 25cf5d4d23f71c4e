"""Claims of the lab book on the costs of the divergence check and of determinism; rules in labbook/claims/claim.py."""

from __future__ import annotations

from typing import Any

from softlab.bench.experiments.findings.determinism import DETERMINISM, RUNS
from softlab.bench.experiments.findings.steady import LENGTH, LENGTH_DT, REST, STEADY
from softlab.bench.measure import words
from softlab.bench.measure.costs_timing import QUICKEST
from softlab.bench.measure.words import number, percent
from softlab.bench.store.schema import tables_by_kind
from softlab.labbook.claims.claim import Claim, Claims, named, on, on_gpu, where
from softlab.plots.core.apart import SMALL, small
from softlab.plots.core.backends import BACKENDS, on_backends
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.findings.points import Cost, check_costs, costs

CLAIMS = Claims()
BOUND = 1.0  # per cent of the time: largest cost of the divergence check


@CLAIMS.add("looks-cost", "The cost of detecting divergence was not measured.")
def check_cost(results: Results) -> Claim:
    """Largest relative cost of a check on each backend, and whether it is below the bound."""
    parts, numbers, busy = [], {}, False
    for backend, source, checks in on_backends(results, check_costs):
        worst = max(checks, key=lambda cost: cost.check_fraction or 0.0)
        largest = numbers[backend] = worst.check_fraction or 0.0
        busy = busy or any(cost.suspect for cost in checks)
        parts.append(
            f"{percent(largest)} of the time on the {named(source, backend)} (the most of {len(checks)} grids: "
            f"{words.masses(worst.particles)}, {worst.precision}, every {words.count(worst.interval)} steps)"
        )
    cheap = 100 * max(needed(numbers).values()) < BOUND
    verdict = f"under {BOUND:g}{words.SPACE}%" if cheap else f"not under {BOUND:g}{words.SPACE}% everywhere"
    if busy:  # steps that are slowed down by other programs make checks seem cheap
        verdict += ", but some of it was measured on a busy machine"
    return Claim(f"A check costs at most {words.listed(parts)}: {verdict}.", numbers, cheap and not busy)


@CLAIMS.add("determinism-cost", "The cost of determinism was not measured.")
def determinism_cost(results: Results) -> Claim:
    """Gather compared with scatter by atomics on the GPU, and with its alternatives on the CPU.

    In float32, at the largest grid of each backend.
    """
    parts, numbers, supported = [], {}, False
    measured = on_backends(results, lambda source, backend: costs(source, DETERMINISM, backend))
    of = {backend: (source, rows) for backend, source, rows in measured}
    if "gpu" in of:
        gpu, rows = of["gpu"]
        variants = _largest(rows)
        if "atomics" in variants:
            atomics = variants["atomics"]
            numbers["atomics"] = atomics.ratio
            supported = atomics.least > 1 or atomics.most < 1
            every = [c for c in rows if c.variant == "atomics" and c.different is not None]
            other, runs = sum(c.different or 0 for c in every), len(every) * (RUNS - 1)
            numbers["different"] = other
            parts.append(
                f"{on_gpu(gpu)} a scatter with atomic additions {_compared(atomics)} the gather "
                f"({words.masses(atomics.particles)}, float32), and {words.count(other)} of {words.count(runs)} repeated "
                "runs gave other bits than the first" + _coloured(variants, numbers)
            )
    if "cpu" in of:
        cpu, rows = of["cpu"]
        variants = _largest(rows)
        texts = [
            f"{text} {_compared(variants[variant])} the lab's kernel"
            for variant, text in (
                ("colours", "a scatter in four colours"),
                ("twice", "a gather that evaluates each spring twice"),
            )
            if variant in variants
        ]
        if texts:
            numbers |= {f"cpu {variant}": cost.ratio for variant, cost in variants.items()}
            supported = supported or all(cost.least > 1 or cost.most < 1 for cost in variants.values())
            size = words.masses(next(iter(variants.values())).particles)
            parts.append(
                f"{on(cpu, 'cpu')}, where the lab's kernel evaluates each spring once and in a fixed order, "
                f"{words.listed(texts)} ({size}, float32)"
            )
    return Claim(". ".join(needed(parts)) + ".", numbers, supported)


def _largest(rows: list[Cost]) -> dict[str, Cost]:
    """Return the costs in float32 at the largest grid, by variant."""
    single = [cost for cost in rows if cost.precision == "float32"]
    most = max((cost.particles for cost in single), default=0)
    return {cost.variant: cost for cost in single if cost.particles == most}


def _compared(cost: Cost) -> str:
    if cost.least <= 1 <= cost.most:
        return "takes, within measurement noise, as long as"
    return f"takes {words.times(cost.ratio)} as long as"


def _coloured(variants: dict[str, Cost], numbers: dict[str, float]) -> str:
    if "colours" not in variants:
        return ""
    numbers["gpu colours"] = variants["colours"].ratio
    return f"; in four colours, which is repeatable, it {_compared(variants['colours'])} the gather"


# ---------------------------------------------------------------------- state, step size and length of a run


def _quickest(source: Source, finding: str, backend: str) -> list[tuple[dict[str, Any], float]]:
    """Return (description, minimum time of a step [s]) of the configurations of a finding on a backend."""
    return [
        (m.description, m.value) for m in source.measures
        if m.name == QUICKEST and m.value and m.backend == backend and m.description.get("finding") == finding
    ]  # fmt: skip


@CLAIMS.add("cost-steady", "Whether the cost of a step depends on its size or on the state was not measured.")
def steady(results: Results) -> Claim:
    """Largest ratio of the costs of a step of S1 over step sizes and states."""
    parts, numbers = list[str](), dict[str, float]()
    for backend, source, runs in on_backends(results, lambda source, backend: _quickest(source, STEADY, backend)):
        times = [seconds for _, seconds in runs]
        numbers[backend] = max(times) / min(times) - 1
        parts.append(f"{percent(numbers[backend])} on {where(backend, source)}")
    flat = all(small(1 + spread) for spread in needed(numbers).values())
    verdict = "less than" if flat else "not everywhere less than"
    text = (
        f"Over all step sizes, in motion and at rest ({words.seconds(REST, 2)} from the start), the cost of a step of S1 in "
        f"float32 differs by at most {words.listed(parts)}: {verdict} the {percent(SMALL)} that count as a difference."
    )
    return Claim(text, numbers, flat)


def _times(source: Source) -> dict[tuple[str, int, int], float]:
    """Return (backend, rows, steps) -> seconds of a machine that timed runs of several lengths on both backends."""
    by_backend = {backend: _quickest(source, LENGTH, backend) for backend in BACKENDS}
    runs = [(backend, *run) for backend, runs in by_backend.items() for run in runs if all(by_backend.values())]
    return {(b, tables_by_kind(what["scene"])["grid"]["rows"], what["steps"]): seconds for b, what, seconds in runs}


@CLAIMS.add("run-length", "How the speed-up depends on the length of a run was not measured.")
def run_length(results: Results) -> Claim:
    """Speed of the GPU over that of the CPU of one machine, by the length of the run, with launch and copy."""
    parts, numbers = list[str](), dict[str, float]()
    source, times = needed(results.first_with(_times))
    for rows in sorted({rows for _, rows, _ in times}):
        texts = []
        for steps in sorted(n for b, r, n in times if (b, r) == ("gpu", rows) and ("cpu", rows, n) in times):
            ratio = numbers[f"{rows} {steps}"] = times["cpu", rows, steps] / times["gpu", rows, steps]
            texts.append(f"{number(ratio, 2)} for {words.seconds(steps * LENGTH_DT, 2)}")
        parts.append(f"at {words.masses(rows * rows)}, {words.listed(texts)}")
    text = (
        f"{on_gpu(source)} over the {source.processor}, one run from the start state to the end state on the host has "
        f"these speed-ups, by its simulated time: {'; '.join(parts)}."
    )
    return Claim(text, numbers, True)
