"""Printed form of `softlab plan`: one table of stages, then the plan of each backend."""

from __future__ import annotations

from rich.console import Console
from rich.table import Column, Table

from softlab.app.plan.fluid import fluid_lines
from softlab.app.plan.passes import BackendPlan
from softlab.app.plan.report import PlanReport, Row, fraction, limit_line
from softlab.app.presentation import presentation_of
from softlab.model.core.spare import counts
from softlab.model.core.stability.limit import frequency_lines
from softlab.model.scene.scene import Scene


def _percent(part: float, whole: float) -> str:
    return f"{100 * fraction(part, whole):.0f} %"


def _cells(report: PlanReport, row: Row, measured: list[str]) -> list[str]:
    """Return a line of the table of stages."""
    name = "  " * row.depth + row.name + (f" (x {row.runs})" if row.runs > 1 else "")
    if row.stage is None:
        return [name]
    moved, done = row.runs * row.stage.bytes(report.item, report.plan.dimensions), row.runs * row.stage.operations
    cells = [name, str(moved), _percent(moved, report.bytes), str(done), _percent(done, report.operations)]
    for backend in measured:
        taken = row.seconds[backend]
        cells += [f"{1e6 * taken:.3g}", _percent(taken, report.seconds(backend))]
    return cells


def _stage_table(report: PlanReport) -> Table:
    measured = [one.name for one in report.backends if report.seconds(one.name)]
    heads = [("bytes", "%"), ("operations", "%"), *((f"{name} us", "%") for name in measured)]
    columns = [Column(head, justify="right", no_wrap=True) for pair in heads for head in pair]
    table = Table(Column("stage", no_wrap=True), *columns, box=None, pad_edge=False)
    for row in report.rows:
        table.add_row(*_cells(report, row, measured))
    total = ["sum", str(report.bytes), "", str(report.operations), ""]
    for name in measured:
        total += [f"{1e6 * report.seconds(name):.3g}", ""]
    table.add_row(*total)
    return table


def _print_backend(console: Console, one: BackendPlan) -> None:
    kernel = f"{one.kernel}:{one.tile}" if one.tile else one.kernel
    console.print(f"{one.name} ({one.device})", soft_wrap=True, markup=False)
    console.print(f"  kernel {kernel}: {one.why}", soft_wrap=True, markup=False)
    if one.tile:
        console.print(f"    {tile_description(one.tile)}", soft_wrap=True)
    for merged in one.passes:
        console.print(f"  {' + '.join(merged.stages)}", soft_wrap=True, markup=False)
        amounts = f"{merged.bytes:.3g} bytes, {merged.operations:.3g} operations per mass"
        console.print(f"    {amounts}; {merged.note}", soft_wrap=True, markup=False)
    if one.step is not None:
        whole = f"  measured: a whole step with this kernel takes {1e6 * one.step:.3g} us"
        console.print(f"{whole}; the stages above were run one by one", soft_wrap=True)
    if one.empty is not None:
        console.print(f"  measured: starting an empty stage takes {1e6 * one.empty:.3g} us", soft_wrap=True)
    if one.unmeasured:
        console.print(f"  not measured: {one.unmeasured}", soft_wrap=True, markup=False)


def tile_description(name: str) -> str:
    """Return the meaning of a tile's name (gpu_backend/core/tiling.py, `Tile.name`).


    '32x8x4h10: a block of 32 columns of 8 threads, 4 masses each; blocks exchange masses every 10 steps'
    """
    columns, threads, masses, steps = (int(part) for part in name.replace("h", "x").split("x"))
    each = "1 mass" if masses == 1 else f"{masses} masses"
    shared = f"blocks exchange masses every {steps} steps" if steps > 1 else "blocks exchange masses every step"
    return f"{name}: a block of {columns} columns of {threads} threads, {each} each" + (f"; {shared}" if steps else "")


def overhead_lines(report: PlanReport) -> list[str]:
    """Return a line for each backend on which an empty stage takes more than half as long as the longest one; the
    fractions then mean little."""
    lines = []
    for one in report.backends:
        longest = max((row.seconds.get(one.name, 0.0) / row.runs for row in report.rows), default=0.0)
        if one.empty is not None and one.empty > longest / 2 > 0:
            lines.append(
                f"{one.name}: starting a stage takes {1e6 * one.empty:.3g} us, more than half of the longest stage: "
                "the percentages show starts rather than work; plan a larger scene to see the work"
            )
    return lines


def amounts(scene: Scene) -> str:
    """Return the number of particles and of their springs, clusters and so on; for a world, per member."""
    return presentation_of(scene).amounts(scene, counts(scene))


def print_plan(console: Console, report: PlanReport) -> None:
    """Print the stages of a step with their bytes and operations, each backend's kernel, and the stability limit."""
    scene = report.scene
    console.print(f"{scene.name}  {amounts(scene)}, {report.plan.dimensions}-D, {report.precision}", soft_wrap=True)
    for line in (limit_line(report), *frequency_lines(scene), *fluid_lines(scene)):
        console.print(line, soft_wrap=True, markup=False)
    measured = ", measured microseconds for all masses" if any(row.seconds for row in report.rows) else ""
    console.print(f"\none step, stage by stage: bytes and operations per mass{measured}", soft_wrap=True)
    console.print(_stage_table(report))
    for line in overhead_lines(report):
        console.print(line, soft_wrap=True, markup=False)
    if report.plan.has("external force"):
        console.print(
            "the operations of the external force are integer operations of its random generator", soft_wrap=True
        )
    for one in report.backends:
        console.print()
        _print_backend(console, one)
    for line in report.shared.lines() if report.shared else ():
        console.print(line, soft_wrap=True, markup=False)
    for name, reason in report.unknown.items():
        console.print(f"\n{name}: {reason}", soft_wrap=True, markup=False)
