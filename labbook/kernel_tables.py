"""The lab book's tables of the kernels: times, shares of the ceilings, joules, and what regions cost under each policy."""

from __future__ import annotations

from bench.store.results import Timing
from labbook import words
from labbook.tables import DASH, Table, table
from labbook.words import number, percent
from plots.core.data import Results, Source, is_suspect, is_wrong
from plots.core.ladder import BACKENDS, fastest, in_order, machine_of, title


def _sizes(kernels: dict[str, list[Timing]]) -> list[tuple[int, int, int]]:
    return sorted({(t.particles, t.rows, t.columns) for times in kernels.values() for t in times})


def kernel_tables(results: Results) -> list[Table]:
    """Time per step of every kernel at every square size, in float32, a table for each backend."""
    found = []
    for backend in BACKENDS:
        source = machine_of(results, backend)
        kernels = source.ladder(backend) if source else {}
        if source and kernels:
            found.append(_times(source, backend, kernels))
    return found


def _times(source: Source, backend: str, kernels: dict[str, list[Timing]]) -> Table:
    names = [name for name, _ in in_order(kernels)]
    cells = {(t.kernel, t.rows, t.columns): t for times in kernels.values() for t in times}
    best = {t.particles: t.kernel for t in fastest(source, backend)}
    rows = []
    for masses, height, width in _sizes(kernels):
        row = [f"{height} {words.TIMES} {width}", best.get(masses, DASH)]
        rows.append([*row, *(short_cell(cells.get((name, height, width))) for name in names)])
    head = ["Masses", "Fastest", *(f"{name} / \N{MICRO SIGN}s" for name in names)]
    return table(f"Time per step of every kernel, float32. {title(source, backend)}", head, rows, left=2)


def short_cell(timing: Timing | None) -> str:
    """The median and the spread: `1.39 (2 %)`; * where suspect, ! where the answer was wrong."""
    if timing is None:
        return DASH
    mark = "!" if is_wrong(timing) else "*" if is_suspect(timing) else ""
    return f"{number(1e6 * timing.median)} ({percent(timing.spread) if timing.spread >= 0.005 else '<1 %'}){mark}"


def region_tables(results: Results) -> list[Table]:
    """What an empty parallel region costs by threads, where idle threads spin and where they sleep."""
    found = []
    for source in results.featured:
        policies = source.machine.record.get("region_policies") or {}
        counts = sorted({int(n) for costs in policies.values() for n in costs})
        if not counts:
            continue
        names = {"active": "spinning", "passive": "sleeping"}
        rows = []
        for count in counts:
            here = [policies.get(policy, {}).get(str(count)) for policy in names]
            rows.append([str(count), *(DASH if cost is None else number(1e6 * cost) for cost in here)])
        head = ["Threads", *(f"{name} / \N{MICRO SIGN}s" for name in names.values())]
        found.append(
            table(f"An empty parallel region, idle threads spinning or sleeping. {source.processor}", head, rows)
        )
    return found
