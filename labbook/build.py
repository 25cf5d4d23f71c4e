"""Builds the lab book: measurements -> figures, claims and tables -> typst -> one PDF.

>>> from softlab.labbook.build import build
>>> build("softlab-results/results.sqlite", "labbook.pdf")

A chapter is a file in entries/ and its name in CHAPTERS. Entries contain only text: numbers of the design come from
labbook/facts.py, sentences that compare from labbook/claims/claim.py, both as data, so that no number is typed by hand.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from softlab.bench.experiments.registry import experiments
from softlab.bench.stress.results import rows_of
from softlab.labbook.answer import winner_tables
from softlab.labbook.claims import (
    ablation,
    accuracy,
    bar_costs,
    bodies,
    body_laws,
    busy,
    claim,
    cloth,
    comparison,
    convergence,
    costs,
    findings,
    fluids,
    gpus,
    hard,
    hard_bodies,
    hard_tetrahedra,
    kernels,
    stability,
    tetrahedra,
)
from softlab.labbook.claims.claim import Claim
from softlab.labbook.claims.declared import claims_of
from softlab.labbook.facts import facts
from softlab.labbook.grid_tables import graphics_tables, thread_tables
from softlab.labbook.listings import listings
from softlab.labbook.machines import machines_apart
from softlab.labbook.rungs import rung_tables
from softlab.labbook.tables import Table, machine_lines, scene_line
from softlab.model.base.errors import BackendUnavailable, InputError
from softlab.model.base.files import check_target, replacing
from softlab.plots.core.data import Origin, Results, Source, is_suspect
from softlab.plots.core.files import without_footer
from softlab.plots.core.older import without_older
from softlab.plots.core.read import load
from softlab.plots.core.style import OLDER
from softlab.plots.draw import FIGURES, FigureFiles, draw_figures

FOLDER = Path(__file__).resolve().parent
COMMITTED = FOLDER / "data"
ENTRIES = ("gpu-design", "cpu-design", "performance")  # the three chapters of the hand-out, of 300 to 500 words each
MAIN = ("answer", *ENTRIES, "conclusions", "lab-step", "accuracy", "material", "fluids", "breaks")
NEW_PAGE = ("answer",)  # these begin on a new page
NOT_PRINTED = (  # figures that softlab figures draws for those who run their experiment
    "ablation", "bar-clusters", "convergence", "crossover", "findings-determinism", "fluids-phases", "hard-bodies",
    "hard-states",
    "joules", "projections", "roofline", "tetrahedra", "tetrahedra-mesh", "throughput",
)  # fmt: skip
PICTURES = FOLDER / "pictures"  # of six scenes, by docs/gallery.py
OPTIONAL = (  # claims whose paragraph is only printed if they were measured
    "fluids-column", "fluids-fastest", "fluids-dam", "fluids-viscosity", "fluids-drop", "fluids-peers", "fluids-rate",
    "hard-tetrahedra",
)  # fmt: skip
FLUSHED = ("references",)  # these begin when every figure before them is placed
APPENDIX = ("rungs", "threads", "gpus", "findings", "references")
CHAPTERS = (*MAIN, *APPENDIX)
CLAIMS = {  # every sentence made from the measurements, by name
    name: sentence
    for claims in (
        *(module.CLAIMS for module in (
            claim, comparison, kernels, accuracy, findings, costs, convergence, stability, hard, ablation, cloth, bodies,
            bar_costs, body_laws, hard_bodies, hard_tetrahedra, busy, tetrahedra, fluids, gpus,
        )),
        *map(claims_of, experiments()),
    )
    for name, sentence in claims.items()
}  # fmt: skip
TABLES = {
    "answer": winner_tables, "graphics": graphics_tables, "threads": thread_tables, "rungs": rung_tables,
}  # fmt: skip
TITLE = "Soft-body lab book"


def committed_data() -> list[Path]:
    """Return the measurements that come with the lab: one text export per machine."""
    return sorted(COMMITTED.glob("*.csv.gz"))


def build(
    stores: Origin | Sequence[Origin] | None,
    out_pdf: str | Path,
    committed: Iterable[str | Path] | None = None,
    helped: bool = False,
) -> Path:
    """Build the lab book from the user's own store(s) and the committed measurements; return the path of the PDF.

    `stores`: open stores or paths (.sqlite, .csv); None: only the committed measurements. `committed`: text exports (None:
    those in labbook/data/). `helped`: see plots/draw.py. The PDF is written to a temporary name and renamed, so
    that an earlier book survives a failure.

    Raises InputError (a store or the output cannot be used, nothing was measured), BackendUnavailable (typst is
    missing).
    """
    path = _target(out_pdf)
    return write_book(load(stores, committed_data() if committed is None else committed), path, helped=helped)


def _target(out_pdf: str | Path) -> Path:
    return check_target(out_pdf, (".pdf",), "the lab book")


def write_book(
    results: Results, out_pdf: str | Path, drawn: Sequence[FigureFiles] | None = None, helped: bool = False
) -> Path:
    """Build the book like `build`, from loaded results; `drawn`: their figures (None: draw them)."""
    path = _target(out_pdf)
    if not results.sources:
        raise InputError("there are no measurements to write about; measure first (softlab sweep)")
    try:
        with tempfile.TemporaryDirectory(prefix="softlab-labbook-") as work:
            folder = Path(work)
            write_sources(results, folder, drawn, helped)
            _compile(folder, path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}; check permissions and space") from None
    return path


def book_data(results: Results) -> dict[str, Any]:
    """Return everything that the template prints, except for the files of the figures."""
    claims = {name: marked_claim(results, name) for name in CLAIMS}
    return {
        "title": TITLE,
        "subtitle": "The mass-spring grid on CPU threads and on CUDA: how fast, and how wrong",
        "machines": machine_lines(results),
        "changed": any("+" in source.code for source in results.sources),
        "notices": notices(results),
        "chapters": list(MAIN),
        "own-page": list(NEW_PAGE),
        "flushed": list(FLUSHED),
        "appendix": list(APPENDIX),
        "facts": facts(),
        "listings": listings(),
        "claims": {name: item.sentence for name, item in claims.items()},
        "unmeasured": {name: claims[name].sentence for name in OPTIONAL if not claims[name].numbers},
        "measured": [name for name, item in claims.items() if item.numbers],
        "scene": scene_line(results),
        "tables": {name: _tables(item, results) for name, item in TABLES.items()},
    }


def marked_claim(results: Results, name: str) -> Claim:
    """Return a claim of the results, or of the committed measurements if the featured ones lack its data. It is marked if
    it has times of two machines, and if it would differ without measurements of older code."""
    chosen, used = _featured(results, name)
    current = without_older(used)
    older = chosen.numbers and current is not used and CLAIMS[name](current) != chosen
    marks = [machines_apart(chosen.sentence, used), OLDER * bool(older)]
    return replace(chosen, sentence=" ".join([chosen.sentence, *filter(None, marks)]))


def _featured(results: Results, name: str) -> tuple[Claim, Results]:
    """Return a claim, and the results that it was made from."""
    featured = CLAIMS[name](results)
    if not featured.numbers and results.committed:
        committed = CLAIMS[name](results.committed)
        if committed.numbers:
            return committed, results.committed
    return featured, results


def _tables(make_tables: Callable[[Results], list[Table]], results: Results) -> list[Table]:
    """Return tables, with the same fallback as `marked_claim`, and a mark at rows that would differ without measurements of
    older code; at the title if all do, or it does."""
    for data in (results, results.committed):
        if data and (tables := make_tables(data)):
            current = without_older(data)
            return tables if current is data else marked_tables(tables, make_tables(current))
    return []


def marked_tables(tables: list[Table], current: list[Table]) -> list[Table]:
    """Mark what differs from the `current` tables, which rest on no older code."""
    rows, titles = [row for one in current for row in one["rows"]], [one["title"] for one in current]
    marked: list[Table] = []
    for one in tables:
        older = [row not in rows for row in one["rows"]]
        if one in current:
            marked.append(one)
        elif all(older) or one["title"] not in titles:
            marked.append(one | {"title": f"{one['title']} {OLDER}"})
        else:
            rows_of_one = zip(one["rows"], older, strict=True)
            marked.append(one | {"rows": [_first_marked(row, one["group"]) if m else row for row, m in rows_of_one]})
    return marked


def _first_marked(row: list[str], group: int) -> list[str]:
    """Return a row with the mark behind its first text after those of its group."""
    first = next(n for n, cell in enumerate(row) if cell and n >= group)
    return [f"{cell} {OLDER}" if n == first else cell for n, cell in enumerate(row)]


def notices(results: Results) -> list[str]:
    """Return the notices on the first page: whose measurements these are, and whether there are some of a GPU."""
    lines = []
    local_sources = [source for source in results.sources if source.by_user]
    gpu = results.with_gpu()
    if not local_sources:
        lines.append(
            "This book was built from the committed measurements alone; nothing was measured where it was built."
        )
    if gpu is None:
        lines.append("No GPU took part: the machine has none, and there are no committed measurements of one.")
    elif local_sources and not gpu.by_user:
        lines.append(
            f"The machine of these measurements has no GPU that could be timed. What is said about the GPU is from the "
            f"committed measurements, made on: {gpu.machine.label}; it is marked “committed”."
        )
    if any(source.older for source in results.sources):
        lines.append(
            f"What rests on measurements whose kernels are not proved to be those of the code that made this book is marked "
            f"{OLDER}; the last page names their commits."
        )
    for source in results.featured:
        if source.left_out:
            lines.append(
                f"{source.left_out} times measured on {source.machine.label} are of another version of the code than the "
                "others of their kind, and are left out: what is compared is of one version. The command that measured "
                "them measures them again (softlab sweep, accuracy, ...)."
            )
    failed = _failed(results, local_sources)
    if failed:
        lines.append(
            f"A bug of this lab: hard cases that were run here failed ({failed}). softlab hard prints the reasons."
        )
    for source in local_sources:
        disturbed = sum(is_suspect(timing) for timing in source.timings)
        if 2 * disturbed > len(source.timings):
            lines.append(
                f"{disturbed} of the {len(source.timings)} times measured on {source.machine.label} are suspect: the machine "
                "was busy. Read its comparisons with care, or measure again on a quiet machine."
            )
    return lines


def _failed(results: Results, local_sources: Sequence[Source]) -> str:
    """Return the user's failed hard cases that the chapter omits because it uses a more complete set."""
    shown = {(row.case, row.integrator, row.precision) for row in hard.verdict_rows(results) if row.verdict == "fail"}
    rows = [row for source in local_sources for row in rows_of(m for m in source.measures if "hard" in m.description)]
    lost = [row for row in rows if row.verdict == "fail" and (row.case, row.integrator, row.precision) not in shown]
    return ", ".join(dict.fromkeys(row.case for row in lost))


def write_sources(
    results: Results, folder: Path, drawn: Sequence[FigureFiles] | None = None, helped: bool = False
) -> None:
    """Write template, entries, figures and data.json into an empty folder for typst."""
    for name in ("labbook.typ", "template.typ"):
        shutil.copyfile(FOLDER / name, folder / name)
    shutil.copytree(PICTURES, folder / "pictures")
    for name in ("entries", "figures"):
        (folder / name).mkdir()
    for name in CHAPTERS:
        shutil.copyfile(FOLDER / "entries" / f"{name}.typ", folder / "entries" / f"{name}.typ")
    data = book_data(results)
    figures = folder / "figures"
    if drawn is None:
        names = [name for name in FIGURES if name not in NOT_PRINTED]
        drawn = draw_figures(results, figures, footer=False, suffixes=("svg",), helped=helped, names=names)
    else:
        for path, height in ((figure.paths[0], figure.footer) for figure in drawn if figure.paths):
            text = without_footer(path.read_text(encoding="utf-8"), height)
            (figures / path.name).write_text(text, encoding="utf-8")
    data["figures"] = {
        figure.name: {
            "file": figure.paths[0].name if figure.paths else None,
            "title": figure.title,
            "caption": figure.caption,
            "reason": figure.reason,
        }
        for figure in drawn
    }
    (folder / "data.json").write_text(json.dumps(data), encoding="utf-8")


def _compile(folder: Path, path: Path) -> None:
    try:
        import typst
    except ImportError as error:
        raise BackendUnavailable(f"typst cannot be loaded ({error})", "pip install typst") from None
    pdf = typst.compile(str(folder / "labbook.typ"), root=str(folder), format="pdf")
    with replacing(path) as temporary:
        temporary.write_bytes(pdf)
