"""The rules by which the hard cases are judged a second time (hard_rules.py), and the lab's own judge, on states made by
hand: each must see what is wrong. No kernel runs."""

from __future__ import annotations

import numpy as np
import pytest
from hard_rules import BOUNDS, ENDS, judged_anew, net_force

from softlab.bench.stress.laws import hanging
from softlab.bench.stress.trial import Check, Trial
from softlab.model.scene.scene import load_scene

SCENE = load_scene("hard/b5")


def rest() -> np.ndarray:
    """Ten rows under a held one: link k from below is k m g / k longer than 1 m."""
    grid, stiffness = SCENE.grid, SCENE.springs.stiffness
    links = 1 + np.arange(grid.rows - 1, 0, -1) * grid.mass * 9.81 / stiffness
    y = -np.concatenate([[0.0], np.cumsum(links)])
    return np.stack(np.broadcast_arrays(np.arange(grid.columns, dtype=float), y[:, None]), axis=-1)


def test_the_hanging_grid_is_at_rest_for_both_judges() -> None:
    assert np.abs(net_force(SCENE, rest())).max() < 1e-13
    assert hanging(SCENE) == pytest.approx(rest(), abs=1e-12)
    trial = Trial(SCENE)
    assert all(check.good for check in trial.rest_checks(trial.start(rest())))
    ENDS["B6"](SCENE, rest().reshape(-1, 2))


@pytest.mark.parametrize("row", [1, 5, 9])
@pytest.mark.parametrize("way", [(1e-8, 0.0), (0.0, 1e-8)])
def test_ten_nanometres_off_are_seen_by_both_judges(row: int, way: tuple[float, float]) -> None:
    """10 N/m and two links or more: 1e-7 N; sideways the links' own tension still holds a hundredth of that, 1e-9 N."""
    moved, trial = rest(), Trial(SCENE)
    moved[row, 4] += way
    expected = np.abs(net_force(SCENE, moved)).max()
    assert expected > 1e-9
    force, speed = trial.rest_checks(trial.start(moved))
    assert force.value == pytest.approx(expected, rel=1e-6) and not force.good and speed.good
    with pytest.raises(AssertionError):
        judged_anew("B7 random", SCENE, "pass", [force], moved.reshape(-1, 2))


def test_what_moves_is_not_at_rest() -> None:
    trial = Trial(SCENE)
    velocity = np.zeros((100, 2))
    velocity[70, 1] = 2e-9
    force, speed = trial.rest_checks(trial.start(rest(), velocity))
    assert force.good and not speed.good


@pytest.mark.parametrize(
    ("relation", "value", "good"),
    [("<", 0.9, True), ("<", 1.0, False), ("<", 1.1, False), (">", 1.1, True), (">", 1.0, False), (">", 0.9, False),
     ("aim <=", 9.0, True), ("", 9.0, True), ("<", np.nan, False), (">", np.nan, False), ("<", np.inf, False)],
)  # fmt: skip
def test_a_bound_is_a_bound(relation: str, value: float, good: bool) -> None:
    assert Check("x", value, "m", relation, 1.0).good == good


@pytest.mark.parametrize("name", BOUNDS)
def test_a_bound_looser_than_told_is_seen(name: str) -> None:
    relation, loosest = BOUNDS[name]
    right = Check(name, 0.0 if "<" in relation else 2.0, "", relation[0], loosest)
    looser = Check(name, right.value, "", relation[0], loosest + 0.01 if "<" in relation else loosest - 0.01)
    case, end = ("B12", np.array([[0.0, -19.48]])) if name == "speed" else ("B9 below", None)
    if not (relation == "<" and loosest == 0):  # 0 is not below 0
        judged_anew(case, SCENE, "pass", [right], end)
    with pytest.raises(AssertionError):
        judged_anew(case, SCENE, "pass", [looser], end)


def test_a_verdict_that_does_not_follow_is_seen() -> None:
    good, missed = Check("largest coordinate", 9.0, "m", "<", 1e3), Check("largest coordinate", 2e3, "m", "<", 1e3)
    for verdict, checks in (("pass", [missed]), ("pass", []), ("known", [good])):
        with pytest.raises(AssertionError):
            judged_anew("B9 below", SCENE, verdict, checks, None)


@pytest.mark.parametrize(
    ("case", "scene", "wrong"),
    [
        ("B6", SCENE, lambda p: p * (1, -1)),  # stands on its head
        ("B5 point", SCENE, lambda p: p + np.array([0.0, 1e-6])),  # the held row has moved
        ("B11", load_scene("hard/b11"), lambda p: p),  # hangs by all of gravity
        ("B12", load_scene("hard/b12"), lambda p: p),
        ("B15", load_scene("hard/b15"), lambda p: p),
    ],
)
def test_ends_that_are_wrong_are_seen(case: str, scene: object, wrong: object) -> None:
    with pytest.raises(AssertionError):
        ENDS[case](scene, wrong(rest()).reshape(-1, 2))  # type: ignore[arg-type, operator]
