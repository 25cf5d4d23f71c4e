"""How still water at rest stays: what is measured of a known motion, what is stored, and what is refused."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from softlab.bench.experiments import fluid_rest
from softlab.bench.experiments.fluid_rest import (
    BOX,
    DEPTH,
    ENERGY,
    GRAVITY,
    SCENES,
    SPEED,
    TANK,
    TIMES,
    FluidRest,
    Still,
    print_rest,
    rows,
    settings,
    watched,
)
from softlab.bench.experiments.fluids import FRAME
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.base.errors import BackendUnavailable

UNIT = GRAVITY * DEPTH


class Known:
    """Two particles that lie still, but at 2 s rise by 0.1 m and fall back, and at 5 s move at 0.3 and 0.4 m/s."""

    def __init__(self) -> None:
        self.steps = 0

    def advance(self, steps: int) -> None:
        self.steps += steps

    def read(self, name: str) -> np.ndarray:
        time = round(self.steps * FRAME, 6)
        if name == "position":
            return np.array([[0.0, 0.1 * (time == 2.0), 0.0], [1.0, 1.0 + 0.1 * (time == 2.0), 0.0]])
        return np.array([[0.3, 0.0, 0.0], [0.0, 0.0, 0.4]]) * (time == 5.0)


def test_a_gain_and_a_speed_are_in_their_spans_and_in_no_other() -> None:
    found = {name: value for name, (value, _, _) in watched(Known(), GRAVITY, 10).items()}
    rms = np.sqrt((0.3**2 + 0.4**2) / 2)
    gains = {2: GRAVITY * 0.1 / UNIT, 6: rms**2 / 2 / UNIT}
    spans = [time for time in TIMES if time <= 10]
    assert found == pytest.approx(
        {f"{ENERGY}{time:g}": gains.get(time, 0.0) for time in spans}
        | {f"{SPEED}{time:g}": rms / np.sqrt(UNIT) if time == 6 else 0.0 for time in spans}
    )


def still(**changes: Any) -> Still:
    one = Still(TANK, "m", "cpu", "macklin", False, 4, 0.05, 0.0, {4: 1e-4, 10: -0.1}, {4: 0.5, 10: 0.01}, None)
    return replace(one, **changes)


def test_water_rests_if_it_gains_nothing_and_is_still_once_it_has_settled() -> None:
    assert still().rests
    assert not still(energy={4: 2e-3, 10: -0.1}).rests, "a gain at any time counts"
    assert not still(speed={4: 0.0, 10: 0.03}).rests
    assert not still(energy={}, speed={}).rests, "nothing is known"


def test_every_combination_is_watched_once() -> None:
    """Three spacings, three viscosities, five substeps, each scheme, both scenes; what a user sees first comes first."""
    whole = [(setting.kind, setting.scene.canonical()) for setting, _ in settings(quick=False)]
    assert len(set(whole)) == len(whole) == 3 * 3 * 5 * 3 * 2
    quick = [setting.scene for setting, seconds in settings(quick=True) if seconds == fluid_rest.SHORT]
    assert len(quick) == 5 * 3 * 2 and {scene.fluid_set.spacing for scene in quick} == {0.05}


def test_it_is_measured_stored_told_and_resumed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tank and a box for a second: what the store holds is what is printed, and nothing is measured twice."""
    monkeypatch.setattr(fluid_rest, "TIMES", (0.5, 1))
    monkeypatch.setattr(fluid_rest, "SETTLED", 0.5)
    monkeypatch.setattr(fluid_rest, "SHORT", 1)
    monkeypatch.setattr(fluid_rest, "SUBSTEPS", (2,))
    monkeypatch.setattr(fluid_rest, "SCHEMES", ("macklin",))
    store, text = Store(":memory:"), io.StringIO()
    how: dict[str, Any] = {"quick": True, "backends": ["cpu"], "progress": False}
    assert FluidRest()(store, **how).measured == 2
    assert FluidRest()(store, **how).measured == 0
    found = {row.kind: row for row in rows(measures(store))}
    assert set(found) == set(SCENES) and set(found[TANK].speed) == {0.5, 1}
    assert 0 < found[TANK].late < 0.1 and found[TANK].gain < 1e-3, "water settles, and its height falls"
    assert 0 < found[BOX].late < 1e-3, "a disturbance of a millionth of a metre stays small"
    print_rest(Console(file=text, width=200), store, FluidRest()(store, **how).machine)
    assert TANK in text.getvalue() and f"{100 * found[TANK].late:.2g}" in text.getvalue()


def test_a_peer_that_is_not_here_is_an_error_that_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(BackendUnavailable, match=r"SPlisHSPlasH is not here; pip install"):
        FluidRest()(Store(":memory:"), quick=True, backends=["cpu"], progress=False, peers=True)
