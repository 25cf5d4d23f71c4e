"""Printed numbers, computed again from the text exports: nothing of labbook, plots or bench is imported here.

The book is made in a process of its own, and read as text. What stands in its table of answers and in sentences is
compared with the exports to the last printed digit, on the machine that is named there, and no sentence may set two
machines or two meshes side by side without saying so.
"""

from __future__ import annotations

import json
import re
import statistics
import subprocess
import sys
from functools import cache
from typing import Any

import pytest
from raw_exports import Run, exports, numbers, runs, samples

BOOK = (
    "import json, sys; from softlab.labbook.build import book_data, committed_data; "
    "from softlab.plots.core.read import load; data = book_data(load(None, committed_data())); "
    "json.dump({k: data[k] for k in ('claims', 'tables')}, sys.stdout)"
)
UNITS = {"ns": 1e-9, "µs": 1e-6, "ms": 1e-3, "s": 1.0, "%": 0.01, "": 1.0}
DIGITS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
TIMES = "\N{MULTIPLICATION SIGN}"
NUMBER = rf"\d[\d \u202f]*(?:\.\d+)?(?:\s?{TIMES}\s?10[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)?"
TIE = 0.15
NONE = "\N{EN DASH}"  # a cell without a value
pytestmark = pytest.mark.filterwarnings("error")


@cache
def book() -> dict[str, Any]:
    done = subprocess.run([sys.executable, "-c", BOOK], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def sentence(name: str) -> str:
    return book()["claims"][name].replace("\N{NO-BREAK SPACE}", " ")


def value(text: str) -> tuple[float, float]:
    """(the value, half a unit of its last digit) of e.g. `6.0 × 10⁻⁴`, `31 µs?`, `1 024` or `12 %`."""
    found = re.match(rf"({NUMBER})\s?(ns|µs|ms|s|%)?", text.replace("\N{NO-BREAK SPACE}", " "))
    assert found, text
    mantissa, _, exponent = re.sub(r"[ \u202f]", "", found[1]).replace(f"{TIMES}10", "e").partition("e")
    scale = UNITS[found[2] or ""] * 10.0 ** int(exponent.translate(DIGITS) or 0)
    return float(mantissa) * scale, 0.5 * 10.0 ** -len(mantissa.partition(".")[2]) * scale


def prints(text: str, expected: float) -> bool:
    shown, half = value(text)
    return abs(shown - expected) <= half * (1 + 1e-6)


def machines(processor: str) -> set[str]:
    """The machines with a processor of this name; a letter tells twins apart, which have one name in the exports."""
    plain = re.sub(r" [A-Z](?=, \d+ cores?\b)", "", processor)
    return {key for export in exports() for key, label in export.labels.items() if plain in label.split("; ")}


# ---------------------------------------------------------------------- the table of page 2


def table() -> list[dict[str, str]]:
    """Its rows by the names of columns, with the scene in each."""
    (made,) = book()["tables"]["answer"]
    rows, scene = [], ("", "")
    for cells in made["rows"]:
        row = dict(
            zip(
                made["head"],
                (cell.replace("\N{NO-BREAK SPACE}", " ").replace(" [older]", "") for cell in cells),
                strict=True,
            )
        )
        scene = (row["Scene"], row["Masses"]) if row["Scene"] else scene
        rows.append(row | {"Scene": scene[0], "Masses": scene[1], "Title": made["title"]})
    return rows


def winner(found: list[Run], target: float) -> tuple[Run | None, Run | None]:
    """(the most accurate, as printed, of those that reach the error within TIE of the fastest, the fastest one)."""
    able = [r for r in found if r.whole is not None and r.resolved and r.error <= target]
    if not able:
        return None, None
    fastest = min(able, key=lambda r: r.whole or 0.0)
    tied = [r for r in able if (r.whole or 0.0) < (1 + TIE) * (fastest.whole or 0.0)]
    return min(tied, key=lambda r: (float(f"{r.error:.1e}"), r.whole)), fastest


def named_in(row: dict[str, str], cell: str) -> set[str]:
    """The machines that a cell such as `CPU (1), float32` or `GPU, float32` means, by the title."""
    number = re.search(r"\((\d+)\)", cell)
    listed = row["Title"].replace("\N{NO-BREAK SPACE}", " ")
    part = listed[listed.index(f"({number[1]}) ") :].split("; (")[0] if number else listed[listed.rindex("rows. ") :]
    kind = cell[:3]
    name = re.search(rf"{kind} ((?:(?!, [CG]PU )[^;.?])+)", part)
    assert name, part
    return machines(name[1].removesuffix(" (committed)").strip())


def test_the_table_of_answers() -> None:
    """Winner, error, times and tie of every row, and that a row without a winner has none."""
    looked_at = 0
    for row in table():
        label = row["Scene"].rpartition("(")[2].rstrip(")")
        masses = round(value(row["Masses"])[0])
        found = [r for r in runs() if r.label == label and r.masses == masses and r.machine in admitted(row)]
        for within in row["Error at most"].split(", "):
            best, fastest = winner(found, value(within)[0])
            if row["Error"] == NONE:
                assert best is None, row
                continue
            assert best is not None and fastest is not None, row
            backend, precision = row["Processor"][:3].lower(), row["Processor"].split(", ")[1]
            assert best.name == (row["Method"], pytest.approx(value(row["Step"])[0], rel=5e-3), backend, precision), row
            assert best.machine in named_in(row, row["Processor"]), row
            assert prints(row["Error"], best.error), row
            assert prints(row["One run"], best.whole or 0.0), row
            assert prints(row["Simulated second"], best.second), row
            assert (row["Tie"] == NONE) == (fastest is best), row
            if fastest is not best:
                assert row["Tie"].startswith(f"{fastest.method}, "), row
                assert prints(row["Tie"].rpartition("error ")[2], fastest.error), row
        looked_at += row["Error"] != NONE
    assert looked_at >= 18


def admitted(row: dict[str, str]) -> set[str]:
    """The machines that the title names: a table compares no others."""
    listed = row["Title"].replace("\N{NO-BREAK SPACE}", " ")
    names = re.findall(r"[CG]PU ((?:(?!, [CG]PU )[^;.?])+)", listed[listed.rindex("rows. ") :])
    return set[str]().union(*(machines(name.removesuffix(" (committed)").strip()) for name in names))


# ---------------------------------------------------------------------- sentences


def least(found: list[Run], target: float, backend: str, whole: bool = False) -> float:
    able = [r for r in found if r.error <= target and r.resolved and r.what["backend"] == backend]
    return min(r.whole or 0.0 if whole else r.second for r in able if not whole or r.whole is not None)


def speed_ups(text: str, found: list[Run], target: float) -> int:
    """Check each `the GPU is 6.8 times as fast as the CPU (2.2 times with the copy ...)`; how many there are."""
    checked = 0
    for who, factor, copied in re.findall(
        r"the ([CG]PU) is ([\d.]+) times as fast as the [CG]PU(?: \(([\d.]+) times with the copy)?", text
    ):
        for shown, whole in ((factor, False), (copied, True)):
            if shown:
                ratio = least(found, target, "cpu", whole) / least(found, target, "gpu", whole)
                assert prints(shown, ratio if who == "GPU" or whole else 1 / ratio), (text, ratio)
                checked += 1
    return checked


def test_gpu_against_cpu_at_equal_error() -> None:
    """At each size, on the one machine that the sentence names; and on the rope."""
    for name, label in (("equal-error", "S1"), ("rope", "S6")):
        text = sentence(name)
        gpu, cpu = re.match(r"On the (.+?) and the (.+?, \d+ cores?)", text).groups()  # type: ignore[union-attr]
        (machine,) = machines(gpu) & machines(cpu)
        target = value(text.partition("at an error of ")[2])[0]
        mine = [r for r in runs() if (r.machine, r.label, r.what["math"]) == (machine, label, "fast")]
        parts = (
            re.split(r"; at |masses, at |fastest configuration of each, at ", text)[1:]
            if name == "equal-error"
            else [text]
        )
        checked = 0
        for part in parts:
            masses = round(value(part)[0]) if name == "equal-error" else 65
            checked += speed_ups(part, [r for r in mine if r.masses == masses], target)
        assert checked >= len(parts)


def test_the_first_step() -> None:
    """The wait of the first and of later processes, from the machine that is named."""
    found = re.findall(
        r"([\d.]+ m?s) the first time and ([\d.]+ m?s) from then on, on the ([CG]PU) \(([^)]+)\)", sentence("starts")
    )
    assert found
    for cold, warm, backend, processor in found:
        for shown, name in ((cold, "start_seconds_cold"), (warm, "start_seconds_warm")):
            known = [
                seconds for export in exports() for (machine, what), seconds in numbers(export, name).items()
                if machine in machines(processor) and export.configurations[what]["backend"] == backend.lower()
            ]  # fmt: skip
            assert any(prints(shown, seconds) for seconds in known)


def bars(machine: str, backend: str, young: float) -> list[dict[str, Any]]:
    """The bars of tetrahedra of a machine: numbers of each configuration."""
    names = (
        "tetrahedra_mesh_error",
        "tetrahedra_solver_error",
        "tetrahedra_motion_error",
        "tetrahedra_count",
        "cost_seconds",
    )
    found = []
    for export in exports():
        tables = {name: numbers(export, name) for name in names}
        for key in tables["tetrahedra_count"]:
            what = export.configurations[key[1]]
            mine = key[0] == machine and what["backend"] == backend and what.get("finding") == "tetrahedra"
            if mine and float(what["scene.beam.young_modulus"]) == young and all(key in tables[name] for name in names):
                found.append({name: tables[name][key] for name in names} | {"solver": what["scene.method.solver"]})
    return found


def test_total_error_of_tetrahedra() -> None:
    """Mesh, time and error of each named bar: no other bar of that mesh is within the bound sooner."""
    text = sentence("tetrahedra-total")
    bound = value(text.partition("the fastest frames within ")[2])[0]
    checked = 0
    for backend, processor, part in re.findall(r"on the ([CG]PU) \(([^)]+)\) (.+?)(?=; on the|$)", text):
        for young, solver, count, seconds, error in re.findall(
            rf"at 10([⁰¹²³⁴⁵⁶⁷⁸⁹]+) Pa (\w+)[\w ]*? with ({NUMBER}) tetrahedra in ({NUMBER} [mµ]?s), error ({NUMBER} %)",
            part,
        ):
            able = [
                bar | {"total": total} for machine in machines(processor)
                for bar in bars(machine, backend.lower(), 10.0 ** int(young.translate(DIGITS)))
                if bar["tetrahedra_motion_error"] >= -0.25 and bar["tetrahedra_count"] == value(count)[0]
                and (total := abs(bar["tetrahedra_mesh_error"])
                     + (1 + bar["tetrahedra_mesh_error"]) * abs(bar["tetrahedra_solver_error"])) <= bound
            ]  # fmt: skip
            best = min(able, key=lambda bar: bar["cost_seconds"])
            assert best["solver"] == solver and prints(seconds, best["cost_seconds"]) and prints(error, best["total"])
            checked += 1
    assert checked


# ---------------------------------------------------------------------- the tables of the hand-out's grid


def steps(machine: str, graphics: bool) -> dict[tuple[str, int | None, int], float]:
    """(backend, threads, masses) -> median time [s] of a step of the swept square grids in float32, kernels by choice."""
    medians: dict[tuple[str, int | None, int], float] = {}
    for export in exports():
        for (where, key), (seconds, _, _) in samples(export, "step").items():
            what = export.configurations[key]
            rows, threads = what.get("scene.grid.rows"), what["threads"]
            swept = (what["precision"], what["kernel"], what["peer"]) == ("float32", "auto", "null")
            if where == machine and swept and rows and rows == what["scene.grid.columns"]:
                if what["graphics"] == str(graphics).lower():
                    count = None if threads == "null" else int(threads)
                    medians[what["backend"], count, int(rows) ** 2] = statistics.median(seconds)
    return medians


def test_the_table_with_and_without_graphics() -> None:
    """Times of both processors at every size, the CPU's with its fastest number of threads, and their ratio."""
    (made,) = book()["tables"]["graphics"]
    title = made["title"].replace("\N{NO-BREAK SPACE}", " ")
    cpu, gpu = re.search(r"CPU: the (.+?, \d+ cores?)(?: \(committed\))? with .*GPU: the (.+?)\. Ratio", title).groups()  # type: ignore[union-attr]
    (machine,) = (key for key in machines(cpu) & machines(gpu) if steps(key, False))
    checked = 0
    for row in made["rows"]:
        masses = round(value(row[0])[0])
        for cells, graphics in ((row[1:4], False), (row[4:], True)):
            measured = {key: second for key, second in steps(machine, graphics).items() if key[2] == masses}
            on_gpu = measured.get(("gpu", None, masses))
            on_cpu = min((second for key, second in measured.items() if key[0] == "cpu"), default=None)
            if on_gpu is None or on_cpu is None:
                assert cells == [NONE] * 3
                continue
            assert prints(cells[0], on_cpu) and prints(cells[1], on_gpu), (row, on_cpu, on_gpu)
            assert prints(cells[2].strip("()"), on_cpu / on_gpu), row
            checked += 1
    assert checked >= 12


def threads_print(row: list[str], ratios: list[tuple[float, float]]) -> bool:
    """True if a row such as `4`, `3.2 (80 %)` prints these speed-ups and efficiencies."""
    return all(
        prints(cell, ratio) and prints(cell.partition("(")[2], efficiency)
        for cell, (ratio, efficiency) in zip(row[1:], ratios, strict=True)
    )


def test_the_tables_of_threads() -> None:
    """Speed-up over the fewest threads that were timed, and efficiency, on each machine."""
    checked = 0
    for made in book()["tables"]["threads"]:
        title = made["title"].replace("\N{NO-BREAK SPACE}", " ")
        (name,) = (
            one for one in processors() if re.search(rf"\b{re.escape(one)}\b", re.sub(r" [A-Z](?=, \d)", "", title))
        )
        sizes = [round(value(cell)[0]) for cell in made["head"][1:]]
        counts = [int(row[0]) for row in made["rows"]]
        candidates = [
            [
                [
                    (ratio := times["cpu", counts[0], n] / times["cpu", count, n], ratio * counts[0] / count)
                    for n in sizes
                ]
                for count in counts
            ]
            for times in (steps(machine, False) for machine in machines(name))
            if all(("cpu", count, n) in times for count in counts for n in sizes)
        ]
        assert any(all(map(threads_print, made["rows"], ratios)) for ratios in candidates), title
        checked += len(counts)
    assert checked


# ---------------------------------------------------------------------- nothing side by side that does not compare


def processors() -> list[str]:
    """The names of all processors, longest first."""
    names = {part for export in exports() for label in export.labels.values() for part in label.split("; ")}
    return sorted(names - {"no GPU"}, key=len, reverse=True)


def processors_in(text: str) -> list[str]:
    text = re.sub(r"(\w) [A-Z](?=, \d+ cores?\b)", r"\1", text)
    return [name for name in processors() if re.search(rf"\b{re.escape(name)}\b", text)]


def test_no_sentence_compares_two_machines_silently() -> None:
    """Times of processors that no machine has together stand in one sentence only if it says that they do not compare."""
    silent = []
    for name, text in book()["claims"].items():
        text = text.replace("\N{NO-BREAK SPACE}", " ")
        together = [machines(processor) for processor in processors_in(text)]
        if len(together) > 1 and not set.intersection(*together) and re.search(r"\d [mµn]?s\b|a second", text):
            silent += [] if "their times do not compare" in text else [f"{name}: {text}"]
    assert not silent


def test_every_sentence_on_tetrahedra_with_a_time_names_its_mesh() -> None:
    for name, text in book()["claims"].items():
        if name.startswith("tetrahedra-") and re.search(r"\d [mµ]?s\b", text.replace("\N{NO-BREAK SPACE}", " ")):
            assert re.search(
                r"\d tetrahedra\b|tetrahedra-stepping", f"{text} {name}".replace("\N{NO-BREAK SPACE}", " ")
            ), text
