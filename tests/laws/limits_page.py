"""Writes docs/limits.md from the table of laws and rows: python -m tests.laws.limits_page (from the repository's
root)."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [folder for folder in (str(ROOT), str(ROOT / "tests" / "laws")) if folder not in sys.path]

import boundaries  # noqa: E402  # tools of the tests, found by the line above
import fluids_at_rest  # noqa: E402
from faults import FAULTS, Fault  # noqa: E402
from lab import Lab  # noqa: E402
from law import LAWS, Law, limit_of  # noqa: E402
from remarks import REMARKS  # noqa: E402
from rows import ALL, REFUSED, Row  # noqa: E402

from softlab.model.core.stability.laws import LIMITS  # noqa: E402

PAGE = ROOT / "docs" / "limits.md"
HEAD = """# Which laws each solver keeps

This page says which laws of mechanics each solver of the lab obeys. The tests in `tests/laws` check them on small scenes: one
scene for each family, solver, integrator, material and scheme, and one test for each law, in float64 and float32. The page is
written from the tables of these tests by `python -m tests.laws.limits_page`; a test fails if it is out of date.

In the [matrix](#matrix),

- *kept* means that the solver obeys the law to rounding, or within the tolerance that the test derives;
- a number means that the scheme cannot obey the law. The test then checks the [bound](#bounds) of that number;
- a letter means that the law [does not apply](#not-applicable).

The [last section](#outside-these-limits) lists what is not modelled, refused, or not tested.
"""
FAULTY = "**fault**: the solver breaks the law today although it should not."


def fault(law: Law, row: Row) -> Fault | None:
    """The first fault that breaks the law for the row in any case and precision."""
    labs = [Lab("cpu", precision) for precision in ("float64", "float32")]
    pairs = [(case, lab) for case in law.cases(row) for lab in labs]
    return next((one for one in FAULTS if one.law == law.name and any(one.breaks(row, *pair) for pair in pairs)), None)


def letters(number: int) -> str:
    """a, b, ... z, aa, ab ..."""
    return (letters(number // 26 - 1) if number >= 26 else "") + chr(ord("a") + number % 26)


def in_cells(*texts: str) -> str:
    """A line of a table."""
    return "| " + " | ".join(text.replace("|", "\\|") for text in texts) + " |"


def page() -> str:
    """The text of docs/limits.md."""
    reasons: dict[str, str] = {}
    faults: dict[str, str] = {}

    def cell(law: Law, row: Row) -> str:
        if reason := law.absent(row):
            return reasons.setdefault(reason, letters(len(reasons)))
        if broken := fault(law, row):
            return f"**fault {faults.setdefault(broken.reason, str(len(faults) + 1))}**"
        limit = limit_of(law.name, row)
        return f"[{LIMITS.index(limit) + 1}](#bounds)" if limit else "kept"

    lines = [HEAD, "## Laws", "", "| law | equation | cases |", "| --- | --- | --- |"]
    for law in LAWS:
        cases = list(dict.fromkeys(case for row in ALL if not law.absent(row) for case in law.cases(row) if case))
        lines.append(in_cells(law.title, law.equation, ", ".join(cases)))
    lines += ["", "## Matrix", ""]
    for family in dict.fromkeys(row.family for row in ALL):
        lines += [f"### {family[0].upper()}{family[1:]}", ""]
        lines += ["| solver | " + " | ".join(law.name for law in LAWS) + " |", "| --- |" + " --- |" * len(LAWS)]
        for row in (one for one in ALL if one.family == family):
            lines.append(f"| {row.name} | " + " | ".join(cell(law, row) for law in LAWS) + " |")
        lines.append("")
    lines += ["## Bounds", "", "| | law | bound | source |", "| --- | --- | --- | --- |"]
    for number, limit in enumerate(LIMITS, start=1):
        lines.append(in_cells(str(number), limit.law, f"{limit.name}: {limit.bound}", limit.source))
    lines += ["", "## Other limits", "", "| solvers | measured or derived | source |", "| --- | --- | --- |"]
    lines += [in_cells(one.subject, one.text, one.source) for one in REMARKS]
    lines += ["", *fluids_at_rest.lines()]
    lines += ["", "## Not applicable", "", *(f"- **{letter}**: {reason}." for reason, letter in reasons.items())]
    refused = [f"{one} {two}" for one, two in REFUSED]
    lines += ["", f"Combinations that a scene refuses have no row: {', '.join(refused)}."]
    lines += ["", *boundaries.lines()]
    if faults:
        lines += ["", "## Faults", "", FAULTY, "", *(f"- **{number}**: {reason}." for reason, number in faults.items())]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    fluids_at_rest.write_picture()
    print(f"wrote {PAGE} and {fluids_at_rest.PICTURE}")
