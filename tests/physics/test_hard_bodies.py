"""Hard cases of bodies: every row keeps its law, each law sees what it is about, and store, table, figures and lab book tell
of them. Variants of the same laws: test_bodies_hard.py, test_bodies_rest.py."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from bodies_scenes import LIVE
from read_figures import LABELS, labels
from rich.console import Console
from synthetic_store import CPU_RECORD, GPU_RECORD, Maker

from softlab.bench.experiments.accuracy.methods import MATCHING
from softlab.bench.experiments.body_scenes import AWAY
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.bench.stress.body_cases import BODY_CASES
from softlab.bench.stress.experiment import judge_case, run_hard
from softlab.bench.stress.report import print_hard
from softlab.bench.stress.results import StoredCheck, disagreements, rows_of
from softlab.bench.stress.shapes import bodies_as_text
from softlab.bench.stress.trial import Trial
from softlab.labbook.build import build
from softlab.labbook.claims import hard as hard_claims
from softlab.labbook.claims import hard_bodies as hard_body_claims
from softlab.model.core.simulation import Simulation, State
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.core.style import settings
from softlab.plots.figures import hard, hard_bodies

HOST: dict[str, Any] = {"threads": 1, "math": "exact", "live": LIVE}
NAMES = {case.name: case for case in BODY_CASES}
CASE = pytest.mark.parametrize("name", NAMES)


@pytest.mark.parametrize("precision", ["float64", "float32"])
@CASE
def test_the_laws_hold(name: str, precision: str) -> None:
    outcome = judge_case(NAMES[name], MATCHING, "cpu", precision, HOST)
    assert outcome.verdict == "pass" and not outcome.diagnosis, outcome.diagnosis
    assert outcome.checks[0].relation and all(check.good for check in outcome.checks)
    drawn = outcome.end is not None
    assert drawn == (NAMES[name].row != "B20") and (not drawn or np.isfinite(outcome.end).all())


# ---------------------------------------------------------------------- what laws see


class Idle(Trial):
    """A solver that does nothing."""

    def advance(self, simulation: Simulation, steps: int) -> None:
        pass


class Stretched(Trial):
    """A state a tenth larger than it was asked for."""

    def open(self, initial: State | None = None, **how: Any) -> Simulation:
        assert initial is not None
        return super().open(replace(initial, position=1.1 * initial.position), **how)


def other(changes: dict[str, Any]) -> type[Trial]:
    """Another scene than the law thinks."""

    class Other(Trial):
        def open(self, *args: Any, **how: Any) -> Simulation:
            return super().open(*args, **how | {"scene": self.scene.replace(changes)})

    return Other


NO_PLANE, LIVELY = other({"plane.point": AWAY["point"]}), other({"contact.separation_speed": 10.0})
SABOTAGE: dict[str, tuple[type[Trial], str]] = {  # what is done -> the number that tells
    "S7 1": (other({"method.substeps": 2}), "spin, off"), "S7 4": (Idle, "spin, off"),
    "A8 flight": (other({"gravity.acceleration": 9.0}), "speed, off"),
    "A10 plane": (Idle, "out of shape"), "A10 line": (Idle, "out of shape"), "A10 point": (Idle, "out of shape"),
    "A10 mirrored": (Idle, "out of shape"), "A10 inside out": (Idle, "out of shape"), "A10 rigid": (Idle, "out of shape"),
    "B16 jelly": (NO_PLANE, "deepest"), "B16 brick": (NO_PLANE, "deepest"),
    "B16 box": (other({"method.substeps": 1}), "deepest"), "B16 body": (other({"bullet.avoids": (0,)}), "least height"),
    "B17 jellies": (LIVELY, "energy gained"), "B17 bricks": (Idle, "nearest"), "B17 deep": (LIVELY, "energy gained"),
    "B17 ball": (Idle, "deepest"),
    "B18 stack": (other({"gravity.acceleration": 2 * 9.81}), "sinking"),
    "B18 load": (other({"method.substeps": 8}), "depth"), "B18 drop": (NO_PLANE, "kinetic energy"),
    "B18 heap": (other({"soft.avoids": (0,)}), "nearest"),
    "B20": (Idle, "trace missing"), "B20 flat": (Stretched, "way to a goal"),
}  # fmt: skip


def test_laws_see_what_breaks_them() -> None:
    blind = {}
    for name, (kind, expected) in SABOTAGE.items():
        checks = NAMES[name].law(kind(NAMES[name].base(), "cpu", "float64", **HOST))
        if not any(check.name.startswith(expected) and not check.good for check in checks):
            blind[name] = checks
    assert not blind
    assert {NAMES[name].law for name in SABOTAGE} >= {case.law for case in BODY_CASES}


def test_a_wrong_bound_is_a_failed_verdict() -> None:
    case = NAMES["A10 rigid"]

    def tighter(trial: Trial) -> list[Any]:
        first, *others = case.law(trial)
        return [replace(first, bound=0.0), *others]

    outcome = judge_case(replace(case, law=tighter), MATCHING, "cpu", "float64", HOST)
    assert outcome.verdict == "fail" and "must be < 0 m" in outcome.diagnosis


# ---------------------------------------------------------------------- the store, and the table


def test_they_are_listed_filtered_kept_and_drawn(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """By row or by name, under their method alone; what is held is not run again."""
    monkeypatch.setattr("softlab.bench.stress.experiment.judge_case", partial(judge_case, options=HOST))
    how: dict[str, Any] = {"backends": ["cpu"], "precisions": ["float64"], "progress": False}
    with Store(tmp_path / "results.sqlite") as store:
        first = run_hard(store, cases=["b17 ball", "B20"], integrators=[MATCHING], **how)
        assert [row.case for row in first.rows] == ["B17 ball", "B20", "B20 flat"] and first.measured == 3
        assert {row.integrator for row in first.rows} == {MATCHING} and all(row.of_bodies for row in first.rows)
        assert [row.shape is None for row in first.rows] == [False, True, True]
        assert (
            first.rows[0].shape
            and first.rows[0].shape.of_bodies
            and np.shape(first.rows[0].shape.position) == (1, 24, 3)
        )
        assert first.pictures == 1 or first.no_pictures
        again = run_hard(store, cases=["B17 ball"], pictures=False, **how)
        assert again.stored == 1 and not again.measured
        assert not run_hard(store, cases=["B20"], quick=True, pictures=False, **how).rows
        assert rows_of(measures(store)) == first.rows
    console = Console(file=io.StringIO(), width=200)
    print_hard(console, first)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "B17 ball" in text and "a ball in a jelly" in text and "3 passed" in text


def test_shapes_of_bodies_are_thinned_by_body() -> None:
    body = np.repeat([0, 1], [30, 970])
    shape = json.loads(bodies_as_text(np.linspace(0, 1, 3000).reshape(1000, 3), body, most=100))
    assert [len(one) for one in shape] == [3, 97] and shape[0][0] == pytest.approx([0, 1 / 3000, 2 / 3000], abs=1e-4)


# ---------------------------------------------------------------------- figures and lab book


def made_up(record: dict[str, Any] = CPU_RECORD, failing: str = "") -> Store:
    store = Store(":memory:")
    Maker(store, record, "one").hard_bodies(failing)
    return store


@pytest.fixture
def results() -> Results:
    return load(made_up(GPU_RECORD))


def test_figures_show_every_case(results: Results) -> None:
    with settings():
        bounds = hard_bodies.draw(results)
        assert not isinstance(bounds, str) and bounds.sources and bounds.caption
    assert labels(bounds.figure) == LABELS["hard-bodies"]
    (ax,) = bounds.figure.axes
    assert len(ax.get_yticklabels()) == len(BODY_CASES) and len(ax.lines) == 4 + 1


def test_shares_of_bounds() -> None:
    for bound, value, expected in (
        ("< 2 m", 1.0, 0.5), ("< 2", -1.0, 0.0), ("> 0.8", 1.6, 0.5), ("> 0.8", 0.0, np.inf), ("< 1e-09 N", None, np.inf),
        ("aim <= 1.5", 1.0, None), ("", 3.0, None),
    ):  # fmt: skip
        assert hard_bodies.bound_ratio(StoredCheck("x", value, "", bound)) == expected


def test_sheets_do_not_count_bodies(results: Results) -> None:
    assert not hard_claims.verdict_rows(results) and len(hard_bodies.body_rows(results)[0]) == 4 * len(BODY_CASES)
    assert isinstance(hard.draw_states(results), str) and isinstance(hard.draw_verdicts(results), str)


def test_claims_follow_the_numbers(results: Results) -> None:
    claims = {name: claim(results) for name, claim in hard_body_claims.CLAIMS.items()}
    assert all(claim.supported for claim in claims.values())
    assert claims["hard-bodies"].numbers["pass"] == 4 * len(BODY_CASES)
    assert claims["hard-body-backends"].numbers == {"different": 0.0, "pairs": 2.0 * len(BODY_CASES), "alone": 0.0}
    assert claims["hard-body-spin"].numbers["float32"] == pytest.approx(0.8)
    broken = load(made_up(failing="B18 stack"))
    assert "bug of this lab: “ten bricks, 10 s”." in hard_body_claims.verdicts(broken).sentence
    assert not disagreements(hard_bodies.body_rows(broken)[0])
    for name, claim in hard_body_claims.CLAIMS.items():
        nothing = claim(load(None))
        assert not nothing.supported and nothing.sentence.endswith("."), name


def test_the_book_tells_of_them(tmp_path: Any) -> None:
    book = build(made_up(), tmp_path / "book.pdf", [])
    assert book.read_bytes().startswith(b"%PDF-")
