"""Comparisons with other programs: stored, resumed, interrupted, told in a table and drawn."""

import io
import math
from pathlib import Path

import pytest

from softlab.bench.experiments.checks import LIMITS
from softlab.bench.peers.base import Peer
from softlab.bench.peers.lab_xpbd import APPROACHES, LabXpbd
from softlab.bench.peers.numpy_grid import NumpyGrid
from softlab.bench.peers.results import print_peers, ratios
from softlab.bench.peers.sweep import run_peers
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures, timings

# ---------------------------------------------------------------------- the comparison


class Broken(Peer):
    """A peer that opens as `how` says."""

    backend = "cpu"
    precisions = ("float32",)

    def __init__(self, how: str):
        self.name = self.label = how

    def available(self):
        return (False, "not installed; pip install it") if self.name == "absent" else (True, "")

    def open(self, scene, precision, threads):
        if self.name == "crashes":
            raise ZeroDivisionError("as peers do")
        opened = NumpyGrid().open(scene, precision, threads)
        if self.name == "wrong":
            opened.constants.gravity *= 2
        return opened


def compared(store, peers, **options):
    options = {
        "scenes": ["grid"],
        "sizes": [16],
        "precisions": ["float32"],
        "repeats": 3,
        "min_seconds": 0.002,
    } | options
    return run_peers(store, backends=["cpu"], peers=peers, progress=False, **options)


def test_a_comparison_is_stored_and_not_measured_twice(tmp_path: Path):
    peers = [NumpyGrid(), Broken("absent"), Broken("crashes"), Broken("wrong")]
    with Store(tmp_path / "results.sqlite") as store:
        summary = compared(store, peers)
        assert summary.measured == 3 and summary.samples == 9 and not summary.interrupted
        assert {reason for _, reason in summary.skipped} == {
            "absent: not installed; pip install it",
            "crashes: as peers do",
        }
        assert {m.reason for m in measures(store, "skipped")} == {reason for _, reason in summary.skipped}
        by_name = {r.peer: r for r in ratios(store, summary.machine)}
        assert set(by_name) == {"numpy", "wrong"}
        numpy = by_name["numpy"]
        assert (numpy.rows, numpy.columns, numpy.backend, numpy.precision, numpy.threads) == (
            16,
            16,
            "cpu",
            "float32",
            1,
        )
        assert numpy.low <= numpy.high and numpy.ratio == pytest.approx(numpy.seconds / numpy.our_seconds)
        assert not numpy.wrong and numpy.difference < LIMITS["float32"]
        assert by_name["wrong"].wrong and by_name["wrong"].difference > 1e-2
        assert all(t.peer for t in timings(store))  # nothing that ordinary figures would take for theirs
        again = compared(store, [NumpyGrid()])
        assert again.stored == 2 and again.samples == 0 and not again.run


def test_what_approaches_a_method_is_told_with_its_error(tmp_path: Path):
    from rich.console import Console

    with Store(tmp_path / "results.sqlite") as store:
        summary = compared(store, [LabXpbd("cpu", 2), NumpyGrid()], scenes=["implicit-16"], sizes=[6])
        assert summary.measured == 2 and not summary.skipped  # NumPy knows the grid alone and is not asked
        (ratio,) = ratios(store, summary.machine)
        assert ratio.scene == "implicit-16" and 0 < ratio.difference < APPROACHES and not ratio.wrong
        assert 0 < ratio.our_difference < ratio.difference  # the lab solves implicit Euler itself
        console = Console(width=150, record=True, file=io.StringIO())
        print_peers(console, store, summary.machine)
    text = console.export_text()
    assert "implicit Euler, 1.04 ms a step" in text and "spacings off" in text and "softlab XPBD, 2" in text


def test_a_new_peer_is_measured_beside_the_lab_again(tmp_path: Path):
    with Store(tmp_path / "results.sqlite") as store:
        compared(store, [NumpyGrid()])
        late = Broken("late")
        summary = compared(store, [NumpyGrid(), late])
        assert summary.measured == 2  # the newcomer, and the lab in the same run
        assert {r.peer for r in ratios(store, summary.machine)} == {"numpy", "late"}


def test_time_limits_are_kept(tmp_path: Path):
    with Store(tmp_path / "results.sqlite") as store:
        none = compared(store, [NumpyGrid()], total_seconds=1e-9)
        assert none.samples == 0 and "used up" in none.skipped[0][1]
        slow = compared(store, [NumpyGrid()], max_seconds=1e-9)
        assert slow.samples == 0 and "over --max-seconds" in slow.skipped[0][1]


def test_ctrl_c_keeps_what_was_measured(tmp_path: Path, monkeypatch):
    class Stops(Broken):
        def open(self, scene, precision, threads):
            raise KeyboardInterrupt

    with Store(tmp_path / "results.sqlite") as store:
        summary = compared(store, [Stops("stops")])
        assert summary.interrupted


def test_the_terminal_s_table(tmp_path: Path):
    from rich.console import Console

    with Store(tmp_path / "results.sqlite") as store:
        summary = compared(store, [NumpyGrid(), Broken("wrong")])
        console = Console(width=150, record=True, file=io.StringIO())
        print_peers(console, store, summary.machine)
        text = console.export_text().replace("\N{NO-BREAK SPACE}", " ")
    assert "16 x 16" in text and "NumPy" in text and "wrong (" in text


def test_the_figure_marks_what_is_wrong(tmp_path: Path):
    from softlab.plots.core.read import load
    from softlab.plots.figures.peers import draw

    with Store(tmp_path / "results.sqlite") as store:
        compared(store, [NumpyGrid(), Broken("wrong")], sizes=[8, 16])
        results = load(store)
    drawing = draw(results)
    assert not isinstance(drawing, str), drawing
    (ax,) = drawing.figure.axes
    crosses = [line for line in ax.get_lines() if line.get_marker() == "x"]
    assert sum(len(line.get_xdata()) for line in crosses) == 2
    assert all(math.isfinite(value) for line in ax.get_lines() for value in line.get_ydata())
