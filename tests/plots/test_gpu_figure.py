"""What is drawn and said of several GPUs, from a made-up machine whose ratios are known."""

from __future__ import annotations

import json
import statistics
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from read_figures import LABELS, labels
from synthetic_store import GPU_RECORD

from softlab.bench.experiments.scaling.experiment import DIFFERENCE, JOULES, Scaling, shared_case, sheet_of
from softlab.bench.store.database import Store
from softlab.bench.store.transfer import load_text
from softlab.labbook.build import committed_data
from softlab.labbook.claims.gpus import CLAIMS
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.core.style import settings
from softlab.plots.figures.scaling import gpus as figure

STEPS = {  # scene, rows, columns, GPUs, link -> seconds of a step
    ("grid", 2048, 2048, 1, "flags"): 16e-6,
    ("grid", 2048, 2048, 2, "flags"): 10e-6,
    ("grid", 2048, 2048, 2, "peer"): 20e-6,
    ("grid", 2048, 2048, 2, "nccl"): 12.8e-6,
    ("grid", 4096, 2048, 2, "flags"): 17e-6,
    ("xpbd", 256, 256, 1, "flags"): 3e-3,
    ("xpbd", 256, 256, 2, "flags"): 2e-3,
}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """A machine with two GPUs, each of which takes 100 W."""
    with pytest.MonkeyPatch.context() as patch, Store(tmp_path_factory.mktemp("gpus") / "made.sqlite") as store:
        patch.setattr("softlab.gpu_backend.domains.devices.devices_for", lambda count: list(range(count)))
        store.add_machine("two", "Made-up machine; 2 x Made-up GPU", GPU_RECORD | {"gpu_count": 2})
        run = store.start_run("two", "softlab sweep --gpus 2", None)
        for (scene, rows, columns, count, link), step in STEPS.items():
            case = shared_case(sheet_of(scene, rows, columns), "float32", count, link, None)
            numbers = Scaling().numbers(case.scene, step, "tiles") | {JOULES: (100 * count * step, "J", None)}
            if count > 1:
                numbers |= {DIFFERENCE: (0.0, "m", None)}
            for name, (value, unit, reason) in numbers.items():
                store.add_measure(run, case.description, "s", name, value, unit, reason)
        return load(store)


def test_the_figure_shows_ratios_and_joules(results: Results) -> None:
    with settings():
        drawing = figure.draw(results)
    assert not isinstance(drawing, str) and drawing.sources
    assert labels(drawing.figure) == LABELS["gpus"]
    faster, joules = drawing.figure.axes
    shown = {line.get_label(): [float(y) for y in line.get_ydata()] for line in faster.get_lines()}
    assert shown["2 GPUs, flags"] == [pytest.approx(1.6)] and "2 GPUs, peer" not in shown
    assert shown["2 GPUs, nccl"] == [pytest.approx(1.25)] and shown["2 GPUs, cloth"] == [pytest.approx(1.5)]
    assert shown["2 GPUs, a grid each"] == [pytest.approx(2 * 16 / 17)]
    one = next(line for line in joules.get_lines() if line.get_label() == "one GPU")
    assert list(one.get_ydata()) == [pytest.approx(1e9 * 100 * 16e-6 / 2048**2)]  # mJ of a million


def test_the_readers_machine_comes_before_one_with_more_points(results: Results) -> None:
    (source,) = results.sources
    mine = replace(source, measures=tuple(m for m in source.measures if m.description.get("link") != "nccl"))
    both = Results((replace(source, by_user=False), mine))
    assert [one.by_user for one, _ in figure.on_several_gpus(both)] == [True, False]


def test_the_sentences_hold_what_was_put_in(results: Results) -> None:
    made = {name: claim(results) for name, claim in CLAIMS.items()}
    assert all(claim.supported for claim in made.values())
    assert made["gpus-strong"].numbers == {"grid 2048 2": pytest.approx(1.6), "xpbd 256 2": pytest.approx(1.5)}
    assert made["gpus-most"].numbers == {"2": pytest.approx(1.6)}
    assert made["gpus-weak"].numbers == {"4096 2": pytest.approx(16 / 17)}
    assert made["gpus-links"].numbers == {"nccl 2048 2": pytest.approx(1.25)}, (
        "peer, a link of former versions, is left out"
    )
    assert made["gpus-bits"].numbers == {"compared": 4, "largest": 0.0}
    assert made["gpus-energy"].numbers == {"2048 2": pytest.approx(2 * 10 / 16)}
    assert 0 < made["gpus-model"].numbers["usual"] < 0.3
    assert "Made-up GPU" in made["gpus-strong"].sentence


def test_of_one_gpu_nothing_is_drawn(tmp_path: Path) -> None:
    with Store(tmp_path / "empty.sqlite") as empty:
        found = load(empty)
    assert isinstance(figure.draw(found), str)


def test_the_committed_ratios_follow_from_the_raw_samples() -> None:
    """Medians of seconds a step, by a query of its own; and what docs/scale.md says of them."""
    (path,) = (path for path in committed_data() if "h100-2" in path.name)
    steps: dict[tuple[Any, ...], list[float]] = {}
    with load_text([path]) as store:
        query = "SELECT description, seconds, steps FROM sample JOIN configuration ON hash = configuration"
        for text, seconds, count in store.query(query):
            told = json.loads(text)
            sheet = told["scene"].get("grid") or told["scene"]["cloth"]
            key = "grid" in told["scene"], sheet["rows"], sheet["columns"], told["gpus"], told.get("link", "")
            steps.setdefault(key, []).append(seconds / count)
    step = {key: statistics.median(values) for key, values in steps.items()}
    assert {len(values) for values in steps.values()} == {7}
    made = {name: claim(load(None, [path])) for name, claim in CLAIMS.items()}
    for size in (2048, 8192, 16384):
        wanted = step[True, size, size, 1, ""] / step[True, size, size, 2, "flags"]
        assert made["gpus-strong"].numbers[f"grid {size} 2"] == pytest.approx(wanted, rel=1e-12)
    wanted = step[False, 4096, 4096, 1, ""] / step[False, 4096, 4096, 2, "flags"]
    assert made["gpus-strong"].numbers["xpbd 4096 2"] == pytest.approx(wanted, rel=1e-12)
    assert made["gpus-bits"].numbers["largest"] == 0 and made["gpus-strong"].numbers["grid 16384 2"] > 1.98
    wanted = step[True, 8192, 8192, 1, ""] / step[True, 16384, 8192, 2, "flags"]
    assert made["gpus-weak"].numbers["16384 2"] == pytest.approx(wanted, rel=1e-12)
