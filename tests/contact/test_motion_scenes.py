"""Pins that move, in scenes: orders, the twisted sheet, words for pins, what is refused."""

from __future__ import annotations

from itertools import pairwise
from math import cos, log2, pi

import numpy as np
import pytest
from cloth_scenes import MOTIONS, cloth_scene
from cloth_solve import cloth, each_solver, solve
from test_motion import ends

from softlab.app.driver import open_simulation
from softlab.bench.reference import cloth as reference_cloth
from softlab.model.base.pins import PIN_WORDS, pin_indices
from softlab.model.contact.cloth_parameters import body_rows
from softlab.model.core.build import build
from softlab.model.core.energy import spring_strain
from softlab.model.mass_spring.cloth_plan import cloth_plan
from softlab.model.scene.scene import Scene, load_scene

ORDERS = {
    "rk4": ("rk4", 4, {"damping": {"coefficient": 0.01}, "structural": {"stiffness": 20.0, "damping": 0.02}}, 64),
    "verlet": ("velocity-verlet", 2, {"structural": {"stiffness": 20.0}}, 256),
}


@each_solver
@pytest.mark.parametrize("case", ORDERS)
def test_orders_are_kept(solver: str, case: str) -> None:
    """Pins that move at constant speeds all the while take no integrator its order: where forces are asked for, at the
    middle of a step too, pins are where they are at that time. From solutions at h, h/2 and h/4, T = 1/4 s."""
    integrator, order, parts, steps = ORDERS[case]
    found = []
    sheet = ends(3, 5)
    for halving in range(3):
        count = steps * 2**halving
        tables = {name: dict(table) for name, table in sheet.items()}
        tables["left"] |= {"duration": 9.0}
        tables["right"] |= {"duration": 9.0, "start": 0.0}
        scene = cloth(3, 5, **tables, **parts, gravity={}, method={"integrator": integrator, "dt": 0.25 / count})
        found.append(solve(solver, scene, count)[0])
    differences = [np.linalg.norm(b - a) for a, b in pairwise(found)]
    assert log2(differences[0] / differences[1]) == pytest.approx(order, abs=0.1)


def test_the_twisted_sheet_is_wrung_and_not_torn() -> None:
    """At 2.2 s its sides have come to rest 120 degrees apart and 0.12 m nearer; a side's long way to the other, around the
    middle line, is sqrt(1.78^2 + (0.47 * 2.09)^2) = 2.03 m at most, 14 % more than its own, unless it gives way inwards."""
    scene = load_scene("cloth-twist")
    with open_simulation(scene, threads=1) as simulation:
        simulation.advance(round(2.2 / scene.method.dt))
        state = simulation.state()
    sheet = state.position.reshape(48, 96, 3).astype(np.float64)
    left, right = sheet[-1, 0] - sheet[0, 0], sheet[-1, -1] - sheet[0, -1]
    assert left @ right / (np.linalg.norm(left) * np.linalg.norm(right)) == pytest.approx(cos(2 * pi / 3), abs=1e-5)
    assert (sheet[:, -1] - sheet[:, 0])[:, 0] == pytest.approx(np.full(48, 1.78), abs=1e-5)
    assert np.ptp(sheet[1:-1, 1:-1, 2]) > 0.5  # out of its plane
    assert spring_strain(scene, state.position).max() < 0.14


def test_pins_by_their_words() -> None:
    index = np.arange(20).reshape(4, 5)
    expected = {
        "none": [], "top": index[0], "bottom": index[-1], "left": index[:, 0], "right": index[:, -1],
        "top-bottom": index[[0, -1]], "left-right": index[:, [0, -1]], "top-corners": [0, 4],
        "edges": [*index[0], *index[-1], *index[:, 0], *index[:, -1]], "every:2": [0, 2, 4],
    }  # fmt: skip
    assert set(expected) == {*PIN_WORDS, "every:2"}
    for word, masses in expected.items():
        found = pin_indices(word, 4, 5)
        assert found.dtype == np.int64 and found.tolist() == sorted({int(mass) for mass in np.ravel(masses)}), word
        mask = reference_cloth.named_mask(word, 4, 5)
        assert np.flatnonzero(mask).tolist() == found.tolist(), word
    assert pin_indices([(3, 1), (0, 0), (3, 1)], 4, 5).tolist() == [0, 16]


def test_a_motion_that_moves_nothing_leaves_nothing() -> None:
    tables = cloth_scene("moving", "lab").as_dict()
    idle = Scene({name: table for name, table in tables.items() if name not in MOTIONS} | {
        "idle": {"kind": "motion", "pins": [[0, 0]]}
    })  # fmt: skip
    assert "motion" not in cloth_plan(idle).parts and "motion" in cloth_plan(Scene(tables)).parts
    assert body_rows(idle, build(idle), np.float32)[0].size == 0
