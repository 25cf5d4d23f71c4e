"""The lab book's tables: titles, column heads with units, and cells as text, made from the results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bench.store.results import Timing
from labbook import words
from labbook.words import number, percent
from plots.core.backends import on_backends
from plots.core.data import Results, Source, is_suspect, is_wrong
from plots.core.ladder import fastest, in_order
from plots.core.ladder import title as machine_title

Table = dict[str, Any]  # title, head: list of str, rows: list of list of str, left: columns that align left
DASH = "\N{EN DASH}"

UNITS = {
    "rows": "masses", "columns": "masses", "spacing": "m", "mass": "kg", "stiffness": "N/m", "rest_length": "m",
    "coefficient": "N s/m", "acceleration": "m/s\u00b2", "magnitude": "N", "dt": "s", "amplitude": "m",
}  # fmt: skip
RECORD = {  # of the machine record, what a reader wants to know
    "cpu": "Processor", "cores": "Cores in use", "memory_gib": "Memory / GiB", "gpu": "GPU",
    "gpu_memory_gib": "GPU memory / GiB", "gpu_driver": "GPU driver", "system": "System",
    "python_build": "Python", "numba": "numba", "llvmlite": "llvmlite", "numba_cuda": "numba-cuda", "numpy": "NumPy",
}  # fmt: skip


def table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> Table:
    """A table as the template takes it; its first `left` columns are set flush left, the others flush right."""
    return {"title": title, "head": list(head), "rows": [list(row) for row in rows], "left": left}


def machine_table(source: Source) -> Table:
    """One machine: hardware, versions, limits, commit and date."""
    record = source.machine.record
    rows = [[label, str(record[name])] for name, label in RECORD.items() if record.get(name) is not None]
    if not source.gpu:
        rows.append(["GPU", "none"])
    layer, policy = source.threading
    if layer:
        rows.append(["Threading layer, wait policy", f"{layer}, {policy}"])
    for name, label in (("copy_bandwidth", "Copy bandwidth"), ("gpu_copy_bandwidth", "GPU copy bandwidth")):
        if record.get(name):
            rows.append([f"{label}, measured", words.bandwidth(record[name])])
    rows += [["Code", source.code], ["Measured", source.date]]
    whose = "Machine" if source.own else "Machine of the committed measurements"
    return table(f"{whose}: {source.machine.label}", ["Property", "Value"], rows, left=2)


def scene_table(results: Results) -> Table | None:
    """The constants of the scene that was swept."""
    source = next((s for s in results.featured if s.scene), None)
    if source is None:
        return None
    rows = []
    for part, fields in sorted(source.scene.items()):
        if isinstance(fields, dict):
            for name, value in sorted(fields.items()):
                if name != "kind":
                    shown = str(value).lower() if isinstance(value, bool) else str(value)
                    rows.append([f"{part}.{name}", shown, UNITS.get(name, "")])
    return table("Constants of the scene that was timed; its size varies", ["Field", "Value", "Unit"], rows, left=3)


# ---------------------------------------------------------------------- of the kernels


def _sizes(kernels: dict[str, list[Timing]]) -> list[tuple[int, int, int]]:
    return sorted({(t.particles, t.rows, t.columns) for times in kernels.values() for t in times})


def kernel_tables(results: Results) -> list[Table]:
    """Time per step of every kernel at every square size, in float32, a table for each backend."""
    return [_times(source, backend, kernels) for backend, source, kernels in on_backends(results, Source.ladder)]


def _times(source: Source, backend: str, kernels: dict[str, list[Timing]]) -> Table:
    names = [name for name, _ in in_order(kernels)]
    cells = {(t.kernel, t.rows, t.columns): t for times in kernels.values() for t in times}
    best = {t.particles: t.kernel for t in fastest(source, backend)}
    rows = []
    for masses, height, width in _sizes(kernels):
        row = [f"{height} {words.TIMES} {width}", best.get(masses, DASH)]
        rows.append([*row, *(short_cell(cells.get((name, height, width))) for name in names)])
    head = ["Masses", "Fastest", *(f"{name} / \N{MICRO SIGN}s" for name in names)]
    return table(f"Time per step of every kernel, float32. {machine_title(source, backend)}", head, rows, left=2)


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
