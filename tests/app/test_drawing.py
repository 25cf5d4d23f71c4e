"""How figures come to disk: laid out once, kept by what is on them, drawn with a second process's help."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from synthetic_store import CPU_RECORD, Maker

from softlab.bench.store.database import Store
from softlab.plots.core import figure_cache
from softlab.plots.core.data import Results
from softlab.plots.core.files import lay_out, plain_power, save, without_footer
from softlab.plots.core.read import load
from softlab.plots.core.style import Drawing, new_figure, settings
from softlab.plots.draw import FIGURES, draw_figures


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's cache that is empty."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def one_timing() -> Results:
    store = Store(":memory:")
    Maker(store, CPU_RECORD, "c").timing((16, 16), 1e-5, backend="cpu", threads=2, layer="omp", wait_policy="passive")
    return load(store)


def drawing(change: Callable[[Any], object] = lambda ax: None, sources: tuple[Any, ...] = ()) -> Drawing:
    figure, (ax,) = new_figure()
    ax.plot([1, 10, 100], [1.0, 2.0, 3.0], "o-", color="red", label="a")
    ax.fill_between([1, 100], [1, 2], [2, 3])
    ax.set_xscale("log")
    ax.set_xlabel("masses")
    change(ax)
    return Drawing(figure, "What is shown.", sources, "A title")


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        (r"$\mathdefault{10^{3}}$", "10³"),
        (r"$\mathdefault{2\times10^{-12}}$", "2\N{MULTIPLICATION SIGN}10⁻¹²"),
        ("", ""),
        ("100", "100"),
        ("$x^{2}$", "$x^{2}$"),
    ],
)
def test_powers_of_ten_are_text(formula: str, text: str) -> None:
    assert plain_power(formula) == text


def test_a_figure_is_laid_out_once_for_all_formats(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    laid, execute = [], ConstrainedLayoutEngine.execute
    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", lambda *a: (laid.append(1), execute(*a)))
    with settings():
        made = drawing()
        save(made, tmp_path, "figure")
        assert len(laid) == 1
        ticks = [label.get_text() for label in made.figure.axes[0].get_xticklabels()]
    assert "10¹" in ticks and not any("$" in text for text in ticks)
    box = made.figure.axes[0].get_tightbbox().transformed(made.figure.transFigure.inverted())
    assert min(box.x0, box.y0) >= 0 and max(box.x1, box.y1) <= 1  # nothing is cut off


def test_the_footer_is_a_strip_above_the_same_figure(tmp_path: Path) -> None:
    """Less the strip it is as large as the figure without, and drawn at the same places."""
    from xml.etree import ElementTree

    (source,) = one_timing().sources
    sizes = {}
    with settings():
        for footer in (True, False):
            made = drawing(sources=(source,))
            (path,) = save(made, tmp_path, f"footer-{footer}", footer=footer, suffixes=("svg",))
            text = without_footer(path.read_text(), made.footer_height) if footer else path.read_text()
            root = ElementTree.fromstring(text)
            sizes[footer] = [float(value) for value in (root.get("viewBox") or "").split()]
            assert root.get("height") == f"{sizes[footer][3]:g}pt"
            assert made.footer_height == pytest.approx(1.5 * 1.3 * 7)  # one line of 7 points, and half of one
    assert sizes[True][1] == pytest.approx(13.65) and sizes[False][1] == 0
    assert sizes[True][2:] == pytest.approx(sizes[False][2:], abs=1e-3)


# ---------------------------------------------------------------------- kept


def test_a_figure_that_was_drawn_before_is_not_drawn_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from matplotlib.figure import Figure

    def fail(*_: Any, **__: Any) -> None:
        raise AssertionError("drawn again")

    with settings():
        before = [path.read_bytes() for path in save(drawing(), tmp_path, "first")]
        monkeypatch.setattr(Figure, "savefig", fail)
        assert [path.read_bytes() for path in save(drawing(), tmp_path, "second")] == before
        with pytest.raises(AssertionError, match="drawn again"):
            save(drawing(lambda ax: ax.set_ylabel("time")), tmp_path, "third")


CHANGES: dict[str, Callable[[Any], object]] = {
    "data": lambda ax: ax.lines[0].set_ydata([1.0, 2.0, 3.0000001]),
    "colour": lambda ax: ax.lines[0].set_color("blue"),
    "marker": lambda ax: ax.lines[0].set_marker("s"),
    "hollow": lambda ax: ax.lines[0].set_markerfacecolor("white"),
    "label": lambda ax: ax.set_xlabel("masses / 1000"),
    "scale": lambda ax: ax.set_yscale("log"),
    "limits": lambda ax: ax.set_ylim(0, 7),
    "ticks": lambda ax: ax.set_xticks([1, 10], ["one", "ten"]),
    "other ticks": lambda ax: ax.set_xticks([1, 10], ["one", "eleven"]),
    "text": lambda ax: ax.text(1, 1, "diverged"),
    "its place": lambda ax: ax.text(1, 2, "diverged"),
    "patch": lambda ax: ax.axhspan(1, 2),
    "its height": lambda ax: ax.axhspan(1, 2.5),
    "cells": lambda ax: ax.pcolormesh([[1, 2], [3, 4]]),
    "other cells": lambda ax: ax.pcolormesh([[1, 2], [3, 5]]),
    "points": lambda ax: ax.scatter([1, 2], [3, 4]),
    "other points": lambda ax: ax.scatter([1, 2], [3, 5]),
    "legend": lambda ax: ax.legend(),
    "title": lambda ax: ax.set_title("S1"),
    "size": lambda ax: ax.figure.set_size_inches(5, 4),
}


def test_what_differs_on_a_figure_makes_another_key() -> None:
    with settings():
        plain = [figure_cache.key_of(drawing().figure) for _ in range(2)]
        changed = {name: figure_cache.key_of(drawing(change).figure) for name, change in CHANGES.items()}
        assert figure_cache.key_of(drawing().figure, ["footer"]) not in {*plain, *changed.values()}
    assert plain[0] == plain[1]
    assert len({plain[0], *changed.values()}) == 1 + len(CHANGES)


def test_other_code_draws_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    before = figure_cache.key_of(drawing().figure)
    monkeypatch.setattr(figure_cache, "_code", lambda: "another version")
    assert figure_cache.key_of(drawing().figure) != before


def test_a_cache_that_cannot_be_written_costs_time_alone(
    own_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figure_cache, "user_cache", lambda name: None)
    with settings():
        (path,) = save(drawing(), tmp_path, "figure", suffixes=("svg",))
    assert path.stat().st_size > 1000 and not own_cache.exists()


def test_the_longest_unused_go_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import os

    monkeypatch.setattr(figure_cache, "MAX_FILES", 2)
    for age, key in enumerate(("c", "b", "a")):  # a is the oldest
        (tmp_path / key).write_text(key)
        figure_cache.store(key, "svg", tmp_path / key)
        for file in (tmp_path / "cache").rglob(f"{key}.svg"):
            os.utime(file, (1000 - age, 1000 - age))
    assert figure_cache.fetch("c", "svg", tmp_path / "out") and (tmp_path / "out").read_text() == "c"
    (tmp_path / "d").write_text("d")
    figure_cache.store("d", "svg", tmp_path / "d")
    assert {key for key in "abcd" if figure_cache.fetch(key, "svg", tmp_path / "out")} == {"c", "d"}


# ---------------------------------------------------------------------- a second process


def test_a_helper_draws_the_same(tmp_path: Path) -> None:
    """Of one timing there is one figure; the others have reasons."""
    results, told = one_timing(), []
    found = {}
    for helped in (True, False):
        (tmp_path / str(helped)).mkdir()
        found[helped] = draw_figures(results, tmp_path / str(helped), helped=helped, report=told.append)
    assert sorted(told) == sorted(2 * list(FIGURES))
    for mine, theirs in zip(found[True], found[False], strict=True):
        assert (mine.name, mine.caption, mine.reason, mine.footer) == (
            theirs.name, theirs.caption, theirs.reason, theirs.footer
        )  # fmt: skip
        assert [p.read_bytes() for p in mine.paths] == [p.read_bytes() for p in theirs.paths]
    assert any(figure.paths for figure in found[True])


def test_without_a_second_process_all_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: Any) -> None:
        raise OSError("no semaphores")

    monkeypatch.setattr("softlab.plots.draw.ProcessPoolExecutor", none)
    (tmp_path / "figures").mkdir()
    assert len(draw_figures(load(Store(":memory:")), tmp_path / "figures", helped=True)) == len(FIGURES)


def test_laying_out_twice_changes_nothing() -> None:
    with settings():
        figure = drawing().figure
        lay_out(figure)
        before = figure.axes[0].get_position().bounds
        lay_out(figure)
        assert figure.axes[0].get_position().bounds == before
