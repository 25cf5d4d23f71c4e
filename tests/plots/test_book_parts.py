"""Tables of the grid, listings, pictures, colours and sizes of letters of the lab book."""

from __future__ import annotations

import filecmp
import re
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.text import Text
from synthetic_store import GPU_RECORD, Maker, cpu_store, gpu_store

from softlab.bench.experiments.group import DRAWN_BY
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure
from softlab.labbook import grid_tables, listings
from softlab.labbook.build import FOLDER, NOT_PRINTED, PICTURES, marked_tables
from softlab.labbook.claims.comparison import crossing_drawing, renderer
from softlab.labbook.facts import facts
from softlab.labbook.tables import table
from softlab.model.base.digest import ROOT
from softlab.plots.core.colours import METHODS
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.core.style import OLDER, settings
from softlab.plots.draw import FIGURES
from softlab.plots.figures import bar, tetrahedra, tetrahedra_decides, tetrahedra_mesh, work_precision

SMALLEST = 7.0  # point
GALLERY = Path(__file__).parents[2] / "docs" / "images" / "gallery"


def measured(suspect: str | None = None) -> Results:
    """A machine whose GPU is ten times as fast without graphics, and overtakes at 128 x 128 masses with them."""
    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "g", wobble=0.01)
    cpu = {"backend": "cpu", "layer": "omp", "wait_policy": "passive"}
    for n in (64, 256):
        for threads, seconds in ((1, 1.6e-4), (4, 5e-5), (16, 2e-5), (32, 4e-5)):
            maker.timing((n, n), seconds, threads=threads, **cpu)
        maker.timing((n, n), 2e-6, backend="gpu")
        maker.timing((n, n), 1e-4, threads=16, graphics=True, suspect=suspect, **cpu)
        maker.timing((n, n), 2e-4 if n == 64 else 5e-5, backend="gpu", graphics=True)
    return load(store)


def words(cell: str) -> str:
    return " ".join(cell.split())


def test_the_table_of_graphics_names_the_fastest_threads_and_marks_suspect_times() -> None:
    (table,) = grid_tables.graphics_tables(measured())
    assert [[words(cell) for cell in row] for row in table["rows"]] == [
        ["4096", "20.0 µs", "2.00 µs", "10", "100 µs", "200 µs", "0.50"],
        ["65 536", "20.0 µs", "2.00 µs", "10", "100 µs", "50.0 µs", "2.0"],
    ]
    assert "?" not in table["title"]
    (marked,) = grid_tables.graphics_tables(measured("load: busy"))
    assert {words(row[4]) for row in marked["rows"]} == {"100 µs?"} and marked["title"].endswith("?: suspect")
    assert grid_tables.graphics_tables(load(cpu_store())) == []


def test_the_renderer_is_named_with_the_path_of_the_state() -> None:
    results = measured()
    (source,) = results.sources
    drawn = [
        Measure("g", "c", "s", "r", {"backend": backend}, DRAWN_BY, None, "", f"{name}, 800 x 600 pixels, {path}")
        for backend, name, path in (
            ("cpu", "llvmpipe (LLVM 15, 256 bits)", "in the host's memory"), ("gpu", "Made-up GPU", "on the GPU")
        )
    ]  # fmt: skip
    made = renderer(Results((replace(source, measures=tuple(drawn)),)))
    assert made.sentence == (
        "On the machine of the Made-up GPU the pictures were drawn by llvmpipe (LLVM 15, 256 bits) (a renderer in software; "
        "800 x 600 pixels, in the host's memory, for the CPU) and Made-up GPU (a graphics processor; 800 x 600 pixels, on "
        "the GPU, for the GPU)."
    )
    assert not renderer(results).supported


def test_the_crossing_with_graphics_is_where_two_power_laws_meet() -> None:
    made = crossing_drawing(measured())
    assert made.supported and made.numbers == {"crossing": pytest.approx(128 * 128), "ratio": pytest.approx(2)}
    assert "suspect" not in made.sentence and "2 of the 2 sizes" in crossing_drawing(measured("load: busy")).sentence
    assert not crossing_drawing(load(cpu_store())).supported


def test_speed_up_and_efficiency_are_over_one_thread_up_to_all_cores() -> None:
    (table,) = grid_tables.thread_tables(measured())
    assert [[words(cell) for cell in row] for row in table["rows"]] == [
        ["1", "1.0 (100 %)", "1.0 (100 %)"], ["4", "3.2 (80 %)", "3.2 (80 %)"], ["16", "8.0 (50 %)", "8.0 (50 %)"],
    ]  # fmt: skip
    assert "one thread" in table["title"] and "--threads" not in table["title"]


def test_without_one_thread_the_table_says_what_to_run() -> None:
    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "g")
    for threads in (2, 16):
        maker.timing((64, 64), 1e-4 / threads, threads=threads, backend="cpu", layer="omp", wait_policy="passive")
    (table,) = grid_tables.thread_tables(load(store))
    assert words(table["rows"][1][1]) == "8.0 (100 %)" and "over 2 threads" in table["title"]
    assert table["title"].endswith("softlab sweep --threads 1 --threads 1x")
    assert grid_tables.thread_tables(load(cpu_store())) == [], "as many threads as cores alone are no scaling"


# ---------------------------------------------------------------------- listings and pictures


@pytest.mark.parametrize("name", listings.LISTINGS)
def test_listings_are_lines_of_their_file(name: str) -> None:
    listing = listings.LISTINGS[name]
    source = [line.strip() for line in (ROOT / listing.file).read_text(encoding="utf-8").splitlines()]
    lines = [line.strip() for line in listing.text().splitlines()]
    assert 5 <= len(lines) <= 15 and all(line in source for line in lines if line != listings.GAP)
    assert lines[0].startswith(listing.ranges[0][0]) and lines[-1].startswith(listing.ranges[-1][1])


def test_a_line_that_is_gone_is_noticed() -> None:
    with pytest.raises(LookupError, match="no such line"):
        listings.Listing("labbook/listings.py", "listings", (("no such line", "return"),)).text()


def test_the_book_shows_six_pictures_of_the_gallery() -> None:
    shown = re.findall(r'\("([a-z-]+)", "', (FOLDER / "labbook.typ").read_text(encoding="utf-8"))
    assert len(shown) == 6 and {f"{name}.webp" for name in shown} == {path.name for path in PICTURES.iterdir()}
    for path in PICTURES.iterdir():
        assert not GALLERY.exists() or filecmp.cmp(path, GALLERY / path.name, shallow=False), "python docs/gallery.py"


# ---------------------------------------------------------------------- figures


def test_a_method_has_one_colour_in_all_figures() -> None:
    for name, (colour, _) in (work_precision.INTEGRATORS | work_precision.IMPLICIT | work_precision.XPBD).items():
        assert colour == METHODS[name]
    for styles in (tetrahedra.STYLES, tetrahedra_decides.STYLES, tetrahedra_mesh.SOLVERS):
        assert {styles[name][1] for name in ("newton", "vbd")} == {METHODS["newton"], METHODS["vertex block descent"]}
    assert {bar.CURVES[name][1] for name in bar.CURVES if "xpbd" in name} == {METHODS["xpbd"]}
    assert bar.CURVES["tetrahedra, newton"][1] == METHODS["newton"]
    explicit = [METHODS[name] for name in work_precision.INTEGRATORS]
    assert len(set(explicit)) == len(explicit), "integrators of one figure"


@pytest.mark.parametrize("name", ["time-per-step", "graphics", "kernels", "lab-step", "work-precision", "peers"])
def test_no_letter_of_a_printed_figure_is_too_small(name: str) -> None:
    assert name not in NOT_PRINTED
    with settings():
        drawing = FIGURES[name](load(gpu_store()))
    assert not isinstance(drawing, str)
    small = {one.get_text() for one in drawing.figure.findobj(Text) if one.get_text() and one.get_fontsize() < SMALLEST}
    assert not small


def test_figures_are_printed_as_wide_as_they_are_drawn() -> None:
    """A narrower figure would have smaller letters."""
    for path in (FOLDER / "entries").glob("*.typ"):
        assert not re.search(r"#fig\([^)]*,", path.read_text(encoding="utf-8")), path.name


def test_facts_explain_suspect_times_on_the_first_page() -> None:
    text = (FOLDER / "labbook.typ").read_text(encoding="utf-8")
    assert all(f'#fact("{name}")' in text and name in facts() for name in ("spread-limit", "shortest-sample"))


def test_rows_that_rest_on_older_code_are_marked_and_a_title_only_if_all_do() -> None:
    rows = [["S1", "0.1", "rk4"], ["", "0.01", "lab"], ["S5", "0.1", "lab"]]
    winners = table("Winners", ("a", "b", "c"), rows, group=1)
    (made,) = marked_tables([winners], [winners | {"rows": rows[:1]}])
    assert made["rows"] == [rows[0], ["", f"0.01 {OLDER}", "lab"], ["S5", f"0.1 {OLDER}", "lab"]]
    assert made["title"] == "Winners"
    (made,) = marked_tables([winners], [])
    assert made["title"] == f"Winners {OLDER}" and made["rows"] == rows
    nothing = table("Nothing", ("a",), [])
    assert marked_tables([winners, nothing], [winners, nothing]) == [winners, nothing]
