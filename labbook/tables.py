"""The lab book's tables: titles, column heads with units, and cells as text, made from the results."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from softlab.bench.store.machine_records import DISTURBED
from softlab.labbook import words
from softlab.labbook.words import number
from softlab.plots.core.data import Results, Source

Table = dict[str, Any]  # title, head: list of str, rows: list of list of str, left: number of columns that align left
DASH = "\N{EN DASH}"
SHORT = 7  # digits of a commit: a column is too narrow for those on the title page

UNITS = {
    "rows": "masses", "columns": "masses", "spacing": "m", "mass": "kg", "stiffness": "N/m", "rest_length": "m",
    "coefficient": "N s/m", "acceleration": "m/s\u00b2", "magnitude": "N", "dt": "s", "amplitude": "m",
}  # fmt: skip
RECORD = {  # fields of the machine record that are printed with the machine's name
    "memory_gib": "Memory / GiB", "gpu_memory_gib": "GPU memory / GiB", "gpu_driver": "GPU driver", "system": "System",
    "python_build": "Python", "numba": "numba", "llvmlite": "llvmlite", "numba_cuda": "numba-cuda", "numpy": "NumPy",
}  # fmt: skip
MEASURED = (
    "Threading layer, wait policy",
    "Copy bandwidth, measured",
    "GPU copy bandwidth, measured",
    "Code",
    "Measured",
    "Measured where",
)


def table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> Table:
    """Return a table for the template; its first `left` columns are set flush left, the others flush right."""
    return {"title": title, "head": list(head), "rows": [list(row) for row in rows], "left": left}


def machine_table(results: Results) -> Table | None:
    """Return hardware, versions, limits, commit and date: a column per machine, a row per property.

    Properties that are equal on all machines are in the title.
    """
    machines = [_machine(source) for source in results.sources]
    names = list(dict.fromkeys(name for told in machines for name in told))
    names.sort(key=[*RECORD.values(), *MEASURED].index)
    values = {name: {told[name] for told in machines if name in told} for name in names}
    alike = [name for name in names if name in RECORD.values() and len(machines) > 1 and len(values[name]) == 1]
    rows = [[name, *(told.get(name, DASH) for told in machines)] for name in names if name not in alike]
    head = ["Property", *(source.place.removesuffix(source.bracket) for source in results.sources)]
    title = "The machines of the measurements"
    if any(re.search(r" [A-Z], \d+ cores?\b", source.machine.label) for source in results.sources):
        title += "; a letter tells those apart that have one name"
    if any(source.threading[1] == "brief" for source in results.sources):
        title += "; wait policy brief: idle threads spin for microseconds, then sleep"
    if alike:
        title += f". Of all: {', '.join(f'{name} {next(iter(values[name]))}' for name in alike)}"
    return table(title, head, rows, left=len(head)) if machines else None


def _machine(source: Source) -> dict[str, str]:
    """Return the properties of one machine."""
    record = source.machine.record
    told = {label: str(record[name]) for name, label in RECORD.items() if record.get(name) is not None}
    layer, policy = source.threading
    disturbed = " (disturbed: other programs ran)" if record.get(DISTURBED) else ""
    limits = [
        f"{words.bandwidth(record[name])}{disturbed}" if record.get(name) else ""
        for name in ("copy_bandwidth", "gpu_copy_bandwidth")
    ]
    whose = "" if source.alone else "here" if source.own else source.label
    code = re.sub(rf"\b([0-9a-f]{{{SHORT}}})[0-9a-f]+\b", r"\1", source.code)
    more = (f"{layer}, {policy}" if layer else "", *limits, code, source.date, whose)
    return told | {name: value for name, value in zip(MEASURED, more, strict=True) if value}


def scene_table(results: Results) -> Table | None:
    """Return the constants of the scene that was swept."""
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


def region_tables(results: Results) -> list[Table]:
    """Return the cost of an empty parallel region by threads, with spinning and with sleeping idle threads."""
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
            table(
                f"An empty parallel region, idle threads spinning or sleeping. {source.processor}{source.bracket}",
                head,
                rows,
            )
        )
    return found
