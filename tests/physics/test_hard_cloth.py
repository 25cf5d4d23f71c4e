"""Hard cases of a cloth: their laws hold, see what they are about, and pictures and tables cope with three dimensions."""

import json
from typing import Any

import numpy as np
import pytest

from softlab.bench.stress.case import HardCase
from softlab.bench.stress.cases import CASES
from softlab.bench.stress.cloth import ball_inside, fast_ball
from softlab.bench.stress.experiment import Outcome, judge_case
from softlab.bench.stress.shapes import as_text
from softlab.bench.stress.trial import Trial
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import Scene, load_scene
from softlab.plots.figures.hard import as_seen

LAWS = {"hard/b16": fast_ball, "hard/b17": ball_inside}
CLOTHS = [case for case in CASES if case.name in ("B16", "B17")]
HOST: dict[str, Any] = {"threads": 1, "math": "exact", "timed": False}


def judged(case: HardCase, integrator: str, precision: str) -> Outcome:
    return judge_case(case, integrator, "cpu", precision, HOST)


@pytest.mark.parametrize("case", CLOTHS, ids=[case.name for case in CLOTHS])
@pytest.mark.parametrize(("integrator", "precision"), [("rk4", "float64"), ("semi-implicit-euler", "float32")])
def test_the_laws_hold(case, integrator, precision):
    """The others than those of test_physics_hard.py, which holds every case under two integrators."""
    outcome = judged(case, integrator, precision)
    assert outcome.verdict == "pass" and not outcome.diagnosis, outcome.diagnosis
    assert outcome.end is not None and outcome.end.shape == (441, 3)


@pytest.mark.parametrize("case", CLOTHS, ids=[case.name for case in CLOTHS])
def test_an_undamped_cloth_is_refused_where_no_step_size_holds(case):
    """explicit Euler has no limit above 0 without damping, and neither scene has any."""
    outcome = judged(case, "explicit-euler", "float64")
    assert outcome.verdict == "refused" and "unstable at every step size" in outcome.diagnosis


class Blind(Trial):
    """Steps a scene without its ball: what a collider that does nothing would do."""

    def open(self, initial=None, **how) -> Simulation:
        tables = {name: table for name, table in self.scene.as_dict().items() if name != "sphere"}
        return super().open(initial, **how | {"scene": Scene(tables)})


@pytest.mark.parametrize("name", LAWS)
def test_laws_see_a_ball_that_is_passed(name):
    """B16: all masses of its way lie behind it. B17: the deepest stays 0.05 m inside."""
    checks = {check.name: check for check in LAWS[name](Blind(load_scene(name), "cpu", "float64", **HOST))}
    bad = [check for check in checks.values() if not check.good]
    if name == "hard/b16":
        assert bad[0].name == "of 14 masses in its way passed by the ball" and bad[0].value == 14
    else:
        (deep,) = bad
        assert deep.value == pytest.approx(0.05, abs=1e-12)


def test_the_fast_ball_is_shown_while_it_is_near():
    """After its first step, 1.67 m on, with the masses that it caught on its front."""
    trial = Trial(load_scene("hard/b16"), "cpu", "float64", **HOST)
    fast_ball(trial)
    assert trial.end_time == pytest.approx(1 / 60)
    assert trial.end is not None and trial.end[:, 2].max() == pytest.approx(-0.8 + 100 / 60 + 0.11, abs=0.01)


def test_shapes_in_space_are_kept_and_seen_from_the_side():
    position = np.stack(np.meshgrid(np.linspace(0, 1, 50), np.linspace(0, -2, 40), indexing="xy"), axis=-1)
    cloth = np.concatenate([position, 0.25 * np.ones((40, 50, 1))], axis=-1)
    shape = np.array(json.loads(as_text(cloth.reshape(-1, 3), 40, 50)))
    assert shape.shape == (33, 33, 3)
    assert shape[-1, -1].tolist() == [1, -2, 0.25]
    seen = as_seen(cloth)
    assert seen.shape == (40, 50, 2) and as_seen(position) is position
    behind = as_seen(cloth - [0, 0, 1.0]) - seen  # 1 m farther off: to the right and up, from right and above
    assert (behind[..., 1] > 0).all() and (behind[..., 0] > 0).all()
