"""docs/add-an-experiment.md: its experiment is one file of at most 60 lines, from which command, table, figure and sentence
follow."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from read_figures import labels
from typer.testing import CliRunner

from softlab import cli
from softlab.bench.declared_commands import add_commands
from softlab.bench.experiments.registry import EXPERIMENTS, experiments
from softlab.bench.measure import case_timing
from softlab.bench.measure.case_timing import Rates
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.labbook.claims.declared import claims_of
from softlab.plots.core.declared import draw
from softlab.plots.core.read import load
from softlab.plots.core.style import settings

PAGE = Path(__file__).resolve().parents[2] / "docs" / "add-an-experiment.md"


@pytest.fixture
def wind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The experiment of the page, saved as a file and registered as the page says."""
    (text,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(text.splitlines()) <= 60
    (tmp_path / "wind_of_the_page.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(EXPERIMENTS, "wind", ("wind_of_the_page:Wind",))
    monkeypatch.setattr(cli.app, "registered_commands", [*cli.app.registered_commands])
    add_commands(cli.app)
    (experiment,) = experiments("wind")
    yield experiment
    del sys.modules["wind_of_the_page"]


def run(words: str) -> str:
    done = CliRunner(env={"COLUMNS": "140"}).invoke(cli.app, words.split())
    assert done.exit_code == 0, done.output
    return done.output


def test_the_command_measures_what_the_page_declares(
    wind: Rates, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(case_timing, "SAMPLE_SECONDS", 0.001)
    store = tmp_path / "results.sqlite"
    command = f"wind --quick --backend cpu --size 8 --speed 1 --speed 16 --store {store}"
    first = run(command)
    assert "2 timed, 0 already in the store" in first and all(head in first for head in wind.table)
    assert "0 timed, 2 already in the store" in run(command)
    with Store(store, readonly=True) as opened:
        rows = wind.rows(measures(opened))
        assert [(row.particles, row.speed) for row in rows] == [(64, 1.0), (64, 16.0)]
        assert all(row.rate * row.step == pytest.approx(64) for row in rows)
        assert all(f"{1e6 * row.step:.3g}" in first for row in rows)
        results = load(opened)
    (claim,) = (claim(results) for claim in claims_of(wind).values())
    ratio = rows[1].step / rows[0].step
    assert claim.supported and list(claim.numbers.values()) == [pytest.approx(ratio)]
    assert claim.sentence.startswith("In the strongest wind a step takes ") and "the CPU (" in claim.sentence
    with settings():
        drawing = draw(wind, results)
    assert not isinstance(drawing, str) and labels(drawing.figure) == [("masses", "masses / s")]
    lines = {line.get_label(): line.get_ydata() for line in drawing.figure.axes[0].get_lines()}
    assert lines == {f"wind of {row.speed:g} m/s": [pytest.approx(row.rate)] for row in rows}


def test_the_help_and_the_refusals_follow(wind: Rates, tmp_path: Path) -> None:
    text = run("wind --help")
    assert all(word in text for word in ("--speed", "--size", "--backend", "--precision", "--store", wind.example))
    assert "wind" in run("--help") and str(wind.__doc__).partition("\n")[0] in text
    refused = CliRunner().invoke(cli.app, ["wind", "--speed", "2", "--store", str(tmp_path / "none.sqlite")])
    assert "must be one of 1, 4, 16" in str(refused.exception)


def test_without_measurements_sentence_and_figure_say_so(wind: Rates) -> None:
    with Store(":memory:") as empty:
        results = load(empty)
    (claim,) = (claim(results) for claim in claims_of(wind).values())
    assert not claim.supported and claim.sentence == "Winds were not timed."
    assert draw(wind, results) == "not measured (softlab wind)"
