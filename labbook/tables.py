"""The lab book's tables: titles, column heads with units, and cells as text, made from the results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bench.experiments.accuracy.equal_error import Fastest, equal_error
from bench.experiments.accuracy.points import pareto_front
from bench.store.results import Timing
from labbook import words
from labbook.words import number
from model.core.integrators import IMPLICIT, INTEGRATORS
from plots.core.accuracy_points import Point, order_points, points
from plots.core.data import THREAD_WORDS, Results, Source, is_suspect, is_wrong
from plots.figures.work_precision import SCENES, accurate_source

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
    rows += [["Code", str(source.version)], ["Measured", source.date]]
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


def time_tables(source: Source) -> list[Table]:
    """Times of one machine with their spread: without and with graphics, float32 and float64."""
    result = []
    for precision in ("float32", "float64"):
        for graphics in (False, True):
            mine = [t for t in source.timings if t.precision == precision and t.graphics == graphics]
            if not mine:
                continue
            columns = [word for word in ("1", *THREAD_WORDS) if any(t.thread_word == word for t in mine)]
            held = {(t.rows, t.columns, t.thread_word): t for t in mine if t.backend == "cpu"}
            gpu = {(t.rows, t.columns): t for t in mine if t.backend == "gpu"}
            shapes = sorted({(t.particles, t.rows, t.columns) for t in mine})
            rows = []
            for _, height, width in shapes:
                cells = [f"{height} {words.TIMES} {width}"]
                cells += [time_cell(held.get((height, width, word))) for word in columns]
                rows.append([*cells, *([time_cell(gpu.get((height, width)))] if gpu else [])])
            drawn = "with graphics" if graphics else "without graphics"
            head = ["Masses", *(f"CPU {word} / \N{MICRO SIGN}s" for word in columns)]
            head += ["GPU / \N{MICRO SIGN}s"] if gpu else []
            result.append(table(f"Time per step, {precision}, {drawn}. {source.provenance}", head, rows))
    return result


def time_cell(timing: Timing | None) -> str:
    """Median [least-greatest repeat] in microseconds; * where suspect, ! where the answer was wrong."""
    if timing is None:
        return DASH
    low, middle, high = (number(1e6 * value) for value in (timing.low, timing.median, timing.high))
    mark = "!" if is_wrong(timing) else "*" if is_suspect(timing) else ""
    return f"{middle} [{low}{DASH}{high}]{mark}"


def error_tables(results: Results) -> list[Table]:
    """Errors of every integrator and step size in float64, one table a scene."""
    source = accurate_source(results)
    tables = []
    names = (*INTEGRATORS, *IMPLICIT)
    for scene in SCENES if source else ():
        found = [p for p in points(source, scene) if p.integrator in names] if source else []
        steps = sorted({p.dt for p in found}, reverse=True)
        if not steps:
            continue
        rows = []
        for name in names:
            mine = {p.dt: p for p in found if (p.integrator, p.precision) == (name, "float64")}
            if mine:
                rows.append([name, *(error_cell(mine.get(dt)) for dt in steps)])
            halves = {p.dt: p for p in order_points(found, name) if p.half is not None}
            if halves:
                rows.append([f"{name}, against half the acceleration", *(_half_cell(halves.get(dt)) for dt in steps)])
        head = ["Integrator", *(f"{1000 * dt:g} ms" for dt in steps)]
        title = f"{scene}: error in spacings against step size, float64. {source.provenance if source else ''}"
        tables.append(table(title, head, rows))
    return tables


def error_cell(point: Point | None) -> str:
    """The error; `diverged`; or with < where the reference does not resolve it."""
    if point is None:
        return DASH
    if point.diverged:
        return "diverged"
    return f"{'' if point.resolved else '< '}{number(point.error, 3)}"


def _half_cell(point: Point | None) -> str:
    return DASH if point is None or point.half is None else number(point.half, 3)


def accurate_sources(results: Results) -> list[Source]:
    """The machines whose accuracy runs were timed: featured ones first, committed ones after."""
    return [s for s in (*results.featured, *results.background) if any(p.seconds for p in points(s))]


def fastest_tables(results: Results) -> list[Table]:
    """The fastest way to each target error and the GPU's speed-up over the CPU at that error, a table a machine."""
    tables = []
    for source in accurate_sources(results):
        rows = []
        for scene in sorted({p.scene for p in points(source)}):
            found = [*points(source, scene), *points(source, scene, "exact")]
            rows += [[scene, *_fastest_cells(row)] for row in equal_error(found)]
        head = ["Scene", "Error / spacings", "Integrator, step size, precision, backend", "Cost / ms per s"]
        head += ["with copy / ms per s", "GPU over CPU", "with copy"]
        title = (
            "The fastest way to an error, the wall time of a simulated second without and with a copy of the end state to "
            f"the host, and how many times as fast the GPU reaches that error as the CPU. {source.provenance}"
        )
        tables.append(table(title, head, rows, left=3))
    return tables


def _fastest_cells(row: Fastest[Point]) -> list[str]:
    best = row.best
    if best is None:
        return [number(row.target, 1), "none of those measured", DASH, DASH, DASH, DASH]
    copied = min((p.copied for p in (row.cpu_copied, row.gpu_copied) if p is not None and p.copied), default=None)
    ratios = (row.speed_up, row.speed_up_copied)
    return [
        number(row.target, 1), best.name, number(1000 * (best.seconds or 0.0)),
        DASH if copied is None else number(1000 * copied), *(DASH if r is None else number(r, 2) for r in ratios),
    ]  # fmt: skip


def pareto_tables(results: Results) -> list[Table]:
    """What no other configuration beats in both error and time, a table a scene, of the first machine."""
    tables = []
    for source in accurate_sources(results)[:1]:
        for scene in SCENES:
            front = pareto_front([*points(source, scene), *points(source, scene, "exact")])
            rows = [
                [
                    p.name,
                    number(p.error, 2),
                    number(1000 * (p.seconds or 0.0)),
                    DASH if p.growth is None else number(p.growth, 2),
                ]
                for p in front
            ]
            head = ["Integrator, step size, precision, backend", "Error / spacings", "Cost / ms per s", "Growth"]
            if rows:
                tables.append(table(f"{scene}: the Pareto front. {source.provenance}", head, rows))
    return tables
