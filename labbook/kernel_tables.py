"""The lab book's tables of the kernels: times, shares of the ceilings, joules, and what regions cost under each policy."""

from __future__ import annotations

from bench.store.results import Timing
from labbook import words
from labbook.tables import DASH, Table, table, time_cell
from labbook.words import number, percent
from plots.core.data import Results, Source
from plots.core.ladder import BACKENDS, fastest, in_order, machine_of, title
from plots.figures.joules import has_joules, joules
from plots.figures.roofline import ceilings

PRECISIONS = ("float32", "float64")


def _sizes(kernels: dict[str, list[Timing]]) -> list[tuple[int, int, int]]:
    return sorted({(t.particles, t.rows, t.columns) for times in kernels.values() for t in times})


def kernel_tables(results: Results) -> list[Table]:
    """Time per step of every kernel at every square size, a table for each backend and precision."""
    found = []
    for backend in BACKENDS:
        source = machine_of(results, backend)
        for precision in PRECISIONS if source else ():
            kernels = source.ladder(backend, precision) if source else {}
            if source and kernels:
                found.append(_times(source, backend, precision, kernels))
    return found


def _times(source: Source, backend: str, precision: str, kernels: dict[str, list[Timing]]) -> Table:
    names = [name for name, _ in in_order(kernels)]
    cells = {(t.kernel, t.rows, t.columns): t for times in kernels.values() for t in times}
    best = {t.particles: t.kernel for t in fastest(source, backend, precision)}
    rows = []
    for masses, height, width in _sizes(kernels):
        row = [f"{height} {words.TIMES} {width}", best.get(masses, DASH)]
        rows.append([*row, *(_short_cell(cells.get((name, height, width))) for name in names)])
    head = ["Masses", "Fastest", *(f"{name} / \N{MICRO SIGN}s" for name in names)]
    return table(f"Time per step of every kernel, {precision}. {title(source, backend)}", head, rows, left=2)


def _short_cell(timing: Timing | None) -> str:
    """The median and the spread: `1.39 (2 %)`, marked as in the other tables."""
    if timing is None:
        return DASH
    mark = time_cell(timing)[-1].replace("]", "")
    return f"{number(1e6 * timing.median)} ({percent(timing.spread) if timing.spread >= 0.005 else '<1 %'}){mark}"


def ceiling_tables(results: Results) -> list[Table]:
    """The share of one step per pass that each kernel reaches, a table for each backend and precision."""
    found = []
    for backend in BACKENDS:
        source = machine_of(results, backend, lambda s, name=backend: ceilings(s, name) is not None)  # type: ignore[misc]
        for precision in PRECISIONS if source else ():
            limits = ceilings(source, backend, precision) if source else None
            if source is None or limits is None:
                continue
            kernels = source.ladder(backend, precision)
            names = [name for name, _ in in_order(kernels)]
            cells = {(t.kernel, t.rows, t.columns): t for times in kernels.values() for t in times}
            rows = []
            for _, height, width in _sizes(kernels):
                here = [cells.get((name, height, width)) for name in names]
                shares = [DASH if t is None else number(100 * limits.share(t)) for t in here]
                rows.append([f"{height} {words.TIMES} {width}", *shares])
            arithmetic = (
                f"the arithmetic roof lies at {percent(limits.arithmetic_share)}"
                if limits.arithmetic_share
                else "the arithmetic rate was not measured"
            )
            caption = (
                f"Share of one step per pass, {precision}, in per cent: {limits.bytes:g} bytes and {limits.operations} "
                f"operations a mass and step, {words.bandwidth(limits.bandwidth)}; {arithmetic}. {title(source, backend)}"
            )
            found.append(table(caption, ["Masses", *names], rows))
    return found


def joule_tables(results: Results) -> list[Table]:
    """Joules per million mass-steps of each kernel, in float32."""
    found = []
    for backend in BACKENDS:
        source = machine_of(results, backend, lambda s, name=backend: has_joules(s, name))  # type: ignore[misc]
        if source is None:
            continue
        kernels = source.ladder(backend)
        names = [name for name, _ in in_order(kernels)]
        cells = {(t.kernel, t.rows, t.columns): joules(source, t) for times in kernels.values() for t in times}
        rows = []
        for _, height, width in _sizes(kernels):
            here = [cells.get((name, height, width)) for name in names]
            rows.append([f"{height} {words.TIMES} {width}", *(DASH if j is None else number(j) for j in here)])
        caption = f"Joules per million mass-steps, float32. {title(source, backend)}"
        found.append(table(caption, ["Masses", *(f"{name} / J" for name in names)], rows))
    return found


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
