"""The lab book: claims follow the data, entries keep their length, the PDF is built or the reason is said.

The stores are made up (tests/tools/synthetic_store.py). Claims about the committed measurements are checked against
labbook/data/ at the end.
"""

import json
import re
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from hand_written import HAND_WRITTEN, failures
from matplotlib.image import imread
from synthetic_store import CPU_RECORD, GPU_RECORD, SIZES, Maker, cpu_store, gpu_store

from softlab.bench.measure import words
from softlab.bench.store.database import Store
from softlab.bench.store.results import open_readonly
from softlab.bench.store.transfer import export
from softlab.labbook.build import (
    CHAPTERS,
    CLAIMS,
    ENTRIES,
    FOLDER,
    NOT_PRINTED,
    book_data,
    build,
    committed_data,
    notices,
    write_sources,
)
from softlab.labbook.claims import accuracy as accuracy_claims
from softlab.labbook.claims import claim as claims
from softlab.labbook.claims import comparison as comparison_claims
from softlab.labbook.facts import constant, facts
from softlab.model.base.errors import InputError
from softlab.plots.core.data import Results
from softlab.plots.core.read import load


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with cpu.csv and gpu.csv: what two machines might have exported."""
    folder = tmp_path_factory.mktemp("exports")
    export(cpu_store(), folder / "cpu.csv")
    export(gpu_store(), folder / "gpu.csv")
    return folder


@pytest.fixture(scope="module")
def variants(folder: Path) -> dict[str, Results]:
    """What a book may be built from."""
    return {
        "cpu alone": load(folder / "cpu.csv"),
        "cpu, committed gpu": load(folder / "cpu.csv", [folder / "gpu.csv"]),
        "own gpu": load(folder / "gpu.csv"),
        "committed alone": load(None, [folder / "gpu.csv", folder / "cpu.csv"]),
        "nothing": load(None),
    }


def noisy() -> Results:
    """Repeats that overlap whatever is compared."""
    return load(cpu_store(wobble=0.98))


# ---------------------------------------------------------------------- claims


def test_every_claim_is_a_sentence_whatever_the_data(variants: dict[str, Results]) -> None:
    for name, claim in CLAIMS.items():
        for variant, results in variants.items():
            made = claim(results)
            assert made.sentence[0].isupper() and made.sentence.endswith("."), (name, variant)
            assert "nan" not in made.sentence.lower() and "None" not in made.sentence, (name, variant)
            assert not made.supported or made.numbers, (name, variant)
            if variant == "nothing" and name != "cloth-limit":  # arithmetic, which needs no measurement
                assert not made.supported, name


def test_thread_claims_follow_the_regions_cost(variants: dict[str, Results]) -> None:
    """On the smallest grid the made-up region costs decide: 1.5, 18 and 43 us, plus 0.27 us for 256 masses."""
    made = claims.threads_at(variants["cpu alone"], 0)
    work = 32 * 256 / 3e10
    assert made.supported
    assert made.numbers["2x"] == pytest.approx((1.8e-5 + work) / (1.5e-6 + work))
    assert made.numbers["4x"] == pytest.approx((4.3e-5 + work) / (1.5e-6 + work))
    assert "as long as with 1x" in made.sentence
    best = claims.threads_best(variants["cpu alone"])
    assert best.numbers["faster"] == 0 and "at none of the" in best.sentence


def test_claims_turn_neutral_where_the_spread_overlaps() -> None:
    results = noisy()
    for end in (0, -1):
        made = claims.threads_at(results, end)
        assert not made.supported and "beyond measurement noise" in made.sentence
    assert not claims.threads_best(results).supported
    assert "no more than measurement noise" in claims.CLAIMS["cpu-float64"](results).sentence
    assert "beyond measurement noise" in comparison_claims.shape(results).sentence


def test_more_threads_are_praised_only_where_they_are_faster() -> None:
    store = Store(":memory:")
    Maker(store, CPU_RECORD, "c").sweep((16, 32), lambda _, threads, masses, precision: masses / threads * 1e-8)
    made = claims.threads_best(load(store))
    assert (
        made.supported and made.numbers["faster"] == 3 and "faster than 1x" in made.sentence
    )  # 100 x 100 is square, too
    assert "of the time of 1x" in claims.threads_at(load(store), -1).sentence


def test_too_few_repeats_and_sizes_left_out_are_told() -> None:
    """Three repeats of 2.6 to 3.0 us beside three of 3.5 to 4.1 us; at another size one side was disturbed."""
    store = Store(":memory:")
    maker = Maker(store, CPU_RECORD, "c", wobble=0.08)
    how = {"backend": "cpu", "layer": "omp", "wait_policy": "passive"}
    for threads, seconds in ((2, 3.84e-6), (4, 2.77e-6), (8, 5e-5)):
        maker.timing((16, 16), seconds, threads=threads, **how)
        maker.timing((32, 32), seconds, threads=threads, suspect="load: busy", **how)
    results = load(store)
    assert "there are too few repeats to distinguish 2x threads" in claims.threads_at(results, 0).sentence
    sentence = claims.threads_best(results).sentence
    assert "of the 1 square sizes that were timed undisturbed (1 more are suspect)" in sentence


def test_no_share_of_a_bandwidth_that_others_disturbed(variants: dict[str, Results]) -> None:
    source = variants["cpu alone"].sources[0]
    assert "%" in claims.CLAIMS["cpu-bandwidth"](Results((source,))).sentence
    record = source.machine.record | {"limits_suspect": "load: other programs ran"}
    disturbed = Results((replace(source, machine=replace(source.machine, record=record)),))
    made = claims.CLAIMS["cpu-bandwidth"](disturbed)
    assert "%" not in made.sentence and "disturbed" in made.sentence and not made.supported


def test_crossover(variants: dict[str, Results]) -> None:
    made = comparison_claims.overtakes(variants["own gpu"])
    assert made.supported and made.numbers["ratio"] > 1
    assert "committed" not in made.sentence
    assert "(committed)" in comparison_claims.overtakes(variants["cpu, committed gpu"]).sentence
    assert not comparison_claims.overtakes(variants["cpu alone"]).supported

    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "g", wobble=0.01)
    for n in SIZES:
        maker.timing((n, n), 1e-9 * n * n, backend="cpu", threads=16, layer="omp", wait_policy="passive")
        maker.timing((n, n), 1e-6, backend="gpu")
    crossed = comparison_claims.overtakes(load(store))
    assert crossed.numbers["crossing"] == pytest.approx(1000)
    assert "overtakes at about 1000" in crossed.sentence


def test_a_slow_gpu_is_said_to_be_slow() -> None:
    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "g")
    maker.timing((64, 64), 1e-5, backend="cpu", threads=16, layer="omp", wait_policy="passive")
    maker.timing((64, 64), 3e-5, backend="gpu")
    assert "the GPU's step takes 3.0" in comparison_claims.overtakes(load(store)).sentence


def test_the_hand_outs_step(variants: dict[str, Results]) -> None:
    results = variants["cpu alone"]
    assert accuracy_claims.lab_newton(results).supported
    assert accuracy_claims.lab_half(results).supported
    assert accuracy_claims.orders(results).numbers == pytest.approx(
        {"semi-implicit-euler": 1, "velocity-verlet": 2, "rk4": 4}
    )
    assert "velocity-verlet, 10 ms" in accuracy_claims.fastest(results).sentence
    assert accuracy_claims.equal_error(variants["own gpu"]).numbers["ratio"] == pytest.approx(10)


def test_wrong_and_suspect_times_are_counted() -> None:
    store = Store(":memory:")
    maker = Maker(store, CPU_RECORD, "c")
    how = {"backend": "cpu", "threads": 2, "layer": "omp", "wait_policy": "passive"}
    maker.timing((16, 16), 1e-5, **how)
    maker.timing((32, 32), 1e-5, error=float("inf"), **how)
    maker.timing((64, 64), 1e-5, suspect="load: busy", **how)
    assert comparison_claims.trust(load(store)).numbers == {
        "timed": 3, "wrong": 1, "suspect": 1, "checked": 3, "left out": 0,
    }  # fmt: skip


# ---------------------------------------------------------------------- words and facts


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1234.5, "1234"),
        (65536, "65 536"),
        (12.345, "12.3"),
        (0.0123, "0.0123"),
        (999.6, "1000"),
        (-0.5, "\N{MINUS SIGN}0.500"),
    ],
)
def test_numbers(value: float, text: str) -> None:
    assert words.number(value).replace(words.THIN, " ") == text


def test_small_numbers_and_units() -> None:
    assert words.number(1.2e-5, 2) == f"1.2{words.SPACE}{words.TIMES}{words.SPACE}10⁻⁵"
    assert words.power(4.671e9, 9) == f"4.67{words.SPACE}{words.TIMES}{words.SPACE}10⁹"
    assert words.seconds(1.5e-6, 2) == f"1.5{words.SPACE}µs"
    assert words.seconds(2.5e-10, 2) == f"0.25{words.SPACE}ns"
    assert words.listed(["a", "b", "c"]) == "a, b and c"
    assert words.listed([]) == ""


def test_facts_are_those_of_the_code() -> None:
    found = facts()
    block = constant("gpu_backend/core/sheet.py", "BLOCK")
    assert [int(found[f"block-{way}"]) for way in ("columns", "rows")] == list(block)
    assert found["bytes-per-mass"] == "32"  # position and velocity, two axes, read and written once in float32
    with pytest.raises(LookupError):
        constant("gpu_backend/core/launch.py", "NO_SUCH_NAME")


# ---------------------------------------------------------------------- entries

WORDS = (300, 500)  # as the hand-out asks
PAGES = (15, 4)  # at most, of the main part and of the appendix


def entry_text(name: str, data: dict[str, Any]) -> str:
    """An entry as a reader sees it, without headings, figures and tables: facts and claims filled in."""
    text = (FOLDER / "entries" / f"{name}.typ").read_text(encoding="utf-8")
    text = re.sub(r"^(#import|=|#fig|#sheets|#listing).*$", "", text, flags=re.MULTILINE)
    text = re.sub(r'#fact\("([^"]+)"\)', lambda found: data["facts"][found[1]], text)
    text = re.sub(r'#claim\("([^"]+)"\)', lambda found: data["claims"][found[1]], text)
    text = re.sub(r"#see\([^)]*\)", " (Figure 1)", text)
    return " ".join(text.replace("*", "").split(" ")).strip()


def word_count(text: str) -> int:
    """Words as a person counts them: what stands between spaces or line ends and holds a letter or digit."""
    return sum(any(character.isalnum() for character in word) for word in re.split(r"[ \n]+", text))


def test_the_hand_outs_entries_keep_their_length(variants: dict[str, Results]) -> None:
    for variant, results in [*variants.items(), ("noisy", noisy())]:
        data = book_data(results)
        for name in ENTRIES:
            count = word_count(entry_text(name, data))
            assert WORDS[0] <= count <= WORDS[1], f"{name} has {count} words ({variant})"


def test_entries_name_what_the_hand_out_asks_for() -> None:
    for name in ("gpu-design", "cpu-design"):
        text = (FOLDER / "entries" / f"{name}.typ").read_text(encoding="utf-8")
        for topic in ("*Threads.*", "*Mutual exclusion.*", "*Synchronisation.*"):
            assert topic in text, name


def test_no_number_is_typed_by_hand() -> None:
    """Digits in the entries: names of things (S1, rk4, float32, 1x), and the half of the hand-out's formula."""
    names = r'#\w+\("[^"]*"\)|\bS[12456]\b|\brk4\b|float(32|64)|\b[124]x\b|\$[^$]*\$|"\.\./template\.typ"'
    for name in set(CHAPTERS) - {"references"}:  # the years and volumes of papers
        text = (FOLDER / "entries" / f"{name}.typ").read_text(encoding="utf-8")
        assert not re.findall(r"\d+", re.sub(names, "", text)), name


def test_every_name_in_the_entries_is_known(variants: dict[str, Results]) -> None:
    from softlab.plots.draw import FIGURES

    data = book_data(variants["cpu alone"])
    known = {"fact": data["facts"], "claim": data["claims"], "fig": FIGURES, "sheets": data["tables"]}
    used: dict[str, set[str]] = {kind: set() for kind in (*known, "see")}
    for name in CHAPTERS:
        text = (FOLDER / "entries" / f"{name}.typ").read_text(encoding="utf-8")
        found = re.findall(r'\b(fact|claim|fig|sheets)\("([^"]+)"', text)
        found += [("claim", word) for word in re.findall(r'#when\("([^"]+)"', text)]
        for call in re.findall(r"#(?:see|shows)\(([^)]*)\)", text):
            found += [("see", word) for word in re.findall(r'"([^"]+)"', call)]
        for kind, word in found:
            assert word in known["fig" if kind == "see" else kind], f"{name}: {kind} {word}"
            used[kind].add(word)
        assert {word for kind, word in found if kind == "fig"} <= {word for kind, word in found if kind == "see"}, (
            f"{name}: a figure that no sentence refers to"
        )
    assert used["claim"] == set(data["claims"]), "a claim that is never printed"
    assert used["fig"] == set(FIGURES) - set(NOT_PRINTED), "a figure that is never printed"
    assert used["sheets"] == set(data["tables"]), "a table that is never printed"


# ---------------------------------------------------------------------- the PDF


@pytest.mark.parametrize("own, committed", [("cpu.csv", ["gpu.csv"]), (None, ["gpu.csv", "cpu.csv"])])
def test_the_book_is_built(folder: Path, tmp_path: Path, own: str | None, committed: list[str]) -> None:
    out = build(own and folder / own, tmp_path / "book.pdf", [folder / name for name in committed])
    assert out.read_bytes().startswith(b"%PDF-")
    assert [path.name for path in tmp_path.iterdir()] == ["book.pdf"]


def test_figures_that_are_missing_leave_a_stated_gap_and_equal_data_equal_bytes(tmp_path: Path) -> None:
    store = Store(":memory:")
    Maker(store, CPU_RECORD, "c").timing((16, 16), 1e-5, backend="cpu", threads=2, layer="omp", wait_policy="passive")
    books = [build(store, tmp_path / f"{name}.pdf", []).read_bytes() for name in ("a", "b")]
    assert books[0] == books[1]


def test_whose_measurements_these_are_is_said(variants: dict[str, Results]) -> None:
    assert "No GPU took part" in " ".join(notices(variants["cpu alone"]))
    (notice,) = notices(variants["cpu, committed gpu"])
    assert "committed measurements, made on: Made-up CPU, 16 cores; Made-up GPU" in notice
    assert notices(variants["own gpu"]) == []
    disturbed = variants["own gpu"]
    source = next(source for source in disturbed.sources if source.by_user)
    busy = tuple(
        replace(timing, suspect=("load: other programs ran on the cores in use",)) for timing in source.timings
    )
    (warning,) = notices(replace(disturbed, sources=(replace(source, timings=busy),)))
    assert "suspect" in warning and f"{len(busy)} of the {len(busy)} times" in warning
    assert "committed measurements alone" in notices(variants["committed alone"])[0]


def test_books_that_cannot_be_built(folder: Path, tmp_path: Path) -> None:
    good = folder / "cpu.csv"
    (tmp_path / "folder.pdf").mkdir()
    for own, out, reason in (
        (good, tmp_path / "book.txt", "must end in .pdf"),
        (good, tmp_path / "missing" / "book.pdf", "does not exist"),
        (good, tmp_path / "folder.pdf", "is a folder"),
        (tmp_path / "none.sqlite", tmp_path / "book.pdf", "no such store"),
        (None, tmp_path / "book.pdf", "no measurements"),
    ):
        with pytest.raises(InputError, match=reason):
            build(own, out, [])
    assert [path.name for path in tmp_path.iterdir()] == ["folder.pdf"]


def test_an_earlier_book_survives_a_failure(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "book.pdf"
    out.write_text("the earlier book")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("softlab.model.base.files.os.replace", full)
    monkeypatch.setattr("softlab.labbook.build.draw_figures", lambda *_, **__: [])
    monkeypatch.setattr(
        "softlab.labbook.build.write_sources", lambda _, folder, *__: (folder / "labbook.typ").write_text("short")
    )
    with pytest.raises(InputError, match="No space left"):
        build(folder / "cpu.csv", out, [])
    assert out.read_text() == "the earlier book"
    assert [path.name for path in tmp_path.iterdir()] == ["book.pdf"]


# ---------------------------------------------------------------------- claims about the committed measurements


def test_hand_written_claims_can_fail(folder: Path, tmp_path: Path) -> None:
    assert failures([folder / "gpu.csv", folder / "cpu.csv"]) == []
    missing = failures([folder / "cpu.csv"])
    assert any("not measured" in line for line in missing)
    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "g")
    maker.timing((64, 64), 1e-5, backend="cpu", threads=16, layer="omp", wait_policy="passive")
    maker.timing((64, 64), 3e-5, backend="gpu")
    contradicted = failures([export(store, tmp_path / "slow.csv")])
    assert any(line.startswith("the GPU is faster at the largest size: the data say") for line in contradicted)
    assert len(contradicted) < len(HAND_WRITTEN)


def test_hand_written_claims_hold_for_the_committed_measurements() -> None:
    paths = committed_data()
    if not paths:
        pytest.skip("labbook/data holds no measurements yet")
    assert failures(paths) == []


def test_no_committed_number_of_a_fluid_is_of_the_former_kernel() -> None:
    """Corrections follow the gradient of their constraint since then; what was measured before is of other motions."""
    since = "2026-11-26T20:35"
    for path in committed_data():
        with open_readonly(path) as store:
            found = store.query(
                "SELECT DISTINCT run.key, started FROM run JOIN (SELECT run, configuration FROM measure UNION "
                "SELECT run, configuration FROM sample) AS numbers ON run.key = numbers.run "
                """JOIN configuration ON hash = numbers.configuration WHERE description LIKE '%"kind":"fluid"%'"""
            )
        assert all(started > since for _, started in found), path.name


def test_the_book_of_the_committed_measurements_keeps_its_length(tmp_path: Path) -> None:
    """Pages of the main part and of the appendix."""
    typst = pytest.importorskip("typst")
    write_sources(load(None, committed_data()), tmp_path)
    main, all_of_it = json.loads(
        typst.query(str(tmp_path / "labbook.typ"), "<pages>", field="value", root=str(tmp_path))
    )
    assert main <= PAGES[0] and all_of_it - main <= PAGES[1]


def test_a_tall_picture_leaves_room_for_a_long_caption(tmp_path: Path) -> None:
    """Nothing is in the lower margin of a page, and the picture is there; a flat one stays as wide as it is told."""
    (tmp_path / "template.typ").write_text((FOLDER / "template.typ").read_text(encoding="utf-8"), encoding="utf-8")
    shapes, figures = {"tall": (100, 150), "flat": (100, 20)}, {}
    (tmp_path / "figures").mkdir()
    for name, (wide, high) in shapes.items():
        drawn = f'<rect width="{wide}" height="{high}" fill="red"/>'
        text = f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide}" height="{high}">{drawn}</svg>'
        (tmp_path / "figures" / f"{name}.svg").write_text(text)
        figures[name] = {"file": f"{name}.svg", "title": "", "caption": "What a reader measured. " * 24, "reason": ""}
    (tmp_path / "data.json").write_text(json.dumps({"figures": figures, "facts": {}, "claims": {}, "tables": {}}))
    (tmp_path / "page.typ").write_text(
        '#import "template.typ": caption-leading, caption-size, fig\n#set page(width: 10cm, height: 16cm, margin: 2cm)\n'
        "#show figure.caption: set text(size: caption-size)\n#show figure.caption: set par(leading: caption-leading)\n"
        '#fig("tall")\n#fig("flat")'
    )
    typst = pytest.importorskip("typst")
    pages = typst.compile(str(tmp_path / "page.typ"), format="png", ppi=72.0)
    for page, (wide, high) in zip(pages, shapes.values(), strict=True):
        pixels = imread(BytesIO(page))[..., :3]
        margin = round(2 / 2.54 * 72)
        assert (pixels[-margin + 2 :] == 1).all(), "the caption ends within the page"
        red = (pixels == (1, 0, 0)).all(axis=-1)
        rows, columns = red.any(axis=1).sum(), red.any(axis=0).sum()
        assert columns / rows == pytest.approx(wide / high, rel=0.1)
        assert (columns == pytest.approx(6 / 2.54 * 72, abs=2)) == (wide > high)
