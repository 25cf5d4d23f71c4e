"""The order in which Gauss-Seidel goes down the rows: every constraint once, the colours in their order, bands in step."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from softlab.cpu_backend.xpbd import schedule as plan
from softlab.cpu_backend.xpbd.tables import Tables
from softlab.model.contact.substep_parameters import xpbd_record
from softlab.model.core.build import build
from softlab.model.position_based.plan import FAMILIES, families, xpbd_parts
from softlab.model.scene.scene import Scene

ROWS = (1, 2, 3, 4, 5, 7, 8, 9, 13, 16, 31)


TOUCHED = {  # rows, from that of the step on
    plan.BEGIN: (0,),
    plan.DOWN: (0, 1),
    plan.ALONG: (0,),
    plan.FAR_DOWN: (0, 2),
    plan.FAR_ALONG: (0,),
    plan.END: (0,),
}


def merged(rows: int, bands: int, has_bending: bool, hasty: int) -> list[tuple[int, int]]:
    """One iteration's steps in an order that threads may take them in: phase by phase, bands in a rotation by `hasty`."""
    steps, starts, _ = plan.schedule(rows, bands, has_bending)
    return [
        (int(what), int(row))
        for phase in range(plan.PHASES)
        for b in np.roll(np.arange(bands), hasty)
        for what, row in steps[starts[b, phase] : starts[b, phase + 1]]
    ]


def wanted(rows: int, has_bending: bool) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """Every step, and those that it must come after: those of earlier colours, or of the prediction, on a row of its own."""
    period = {plan.DOWN: 1, plan.FAR_DOWN: 2}

    def rank(step: tuple[int, int]) -> tuple[int, int]:
        what, i = step
        return what, i // period[what] % 2 if what in period else 0

    kinds = [what for what in TOUCHED if has_bending or what not in (plan.FAR_DOWN, plan.FAR_ALONG)]
    steps = [(what, i) for what in kinds for i in range(rows - TOUCHED[what][-1])]
    return {
        step: [
            other for other in steps
            if rank(other) < rank(step)
            and {other[1] + k for k in TOUCHED[other[0]]} & {step[1] + k for k in TOUCHED[step[0]]}
        ]
        for step in steps
    }  # fmt: skip


@pytest.mark.parametrize("has_bending", [False, True])
def test_every_step_once_and_after_those_of_earlier_colours(has_bending: bool) -> None:
    """For every number of bands, and whichever of them is ahead."""
    for rows in ROWS:
        before = wanted(rows, has_bending)
        for bands in range(1, min(5, plan.most_bands(rows, has_bending)) + 1):
            for hasty in range(bands):
                order = merged(rows, bands, has_bending, hasty)
                assert sorted(order) == sorted(before), (rows, bands, hasty)
                place = {step: k for k, step in enumerate(order)}
                for step, earlier in before.items():
                    assert all(place[other] < place[step] for other in earlier), (rows, bands, hasty, step)


def test_the_check_sees_what_it_looks_for() -> None:
    """Not vacuous: an order with two steps of one row exchanged breaks a rule."""
    before = wanted(4, False)
    assert (plan.DOWN, 0) in before[plan.DOWN, 1] and (plan.DOWN, 1) in before[plan.ALONG, 2]
    assert (plan.ALONG, 0) not in before[plan.DOWN, 2]


@pytest.mark.parametrize("has_bending", [False, True])
def test_in_a_phase_no_two_bands_touch_the_same_row(has_bending: bool) -> None:
    """So that they may run at the same time."""
    for rows, bands in product(ROWS, range(1, 5)):
        if bands > plan.most_bands(rows, has_bending):
            continue
        steps, starts, bounds = plan.schedule(rows, bands, has_bending)
        assert bounds[0] == 0 and bounds[-1] == rows and (np.diff(bounds) > 0).all()
        for phase in range(plan.PHASES):
            owner: dict[int, int] = {}
            for b in range(bands):
                for what, row in steps[starts[b, phase] : starts[b, phase + 1]]:
                    for k in TOUCHED[int(what)]:
                        assert owner.setdefault(int(row) + k, b) == b, (rows, bands, phase, row + k)


@pytest.mark.parametrize("ordering", ["gauss-seidel", "jacobi"])
def test_tables_hold_every_constraint_and_nothing_else(ordering: str) -> None:
    """Reciprocals are 1 / (stiffening weight + compliance), of Jacobi with the valences counted by hand; rows that weigh
    alike share one, so that a large sheet has few."""
    scene = Scene(
        {
            "cloth": {"rows": 40, "columns": 9, "pinned": [[0, 0], [20, 4]]},
            "structural": {"stiffness": 50.0}, "shear": {"compliance": 0.0}, "bending": {"stiffness": 2.0},
            "method": {"solver": "xpbd", "ordering": ordering},
        }
    )  # fmt: skip
    parts, body = xpbd_parts(scene), build(scene)
    record = xpbd_record(scene, np.float64)
    tables = Tables(scene, body, np.float64, parts)
    rows, number = tables.reciprocals(record)
    assert len(tables.weights) == 3 and len(rows) < 60
    weight = (body.inverse_mass > 0).reshape(40, 9).astype(float)
    ends = {}
    for family in families(parts):
        for i, j in product(range(40 - family.rows), range(9 - abs(family.columns))):
            first, second = (i, j + max(0, -family.columns)), (i + family.rows, j + max(0, family.columns))
            ends[family.name, i, j] = first, second
    valence = np.zeros((40, 9))
    for first, second in ends.values():
        valence[first] += 1
        valence[second] += 1
    found = rows[number]
    for k, family in enumerate(FAMILIES):
        softness = {"structural": 1 / 50, "shear": 0.0, "bending": 1 / 2}[family.kind]
        for i, j in product(range(40), range(9)):
            expected = 0.0
            if (family.name, i, j) in ends:
                first, second = ends[family.name, i, j]
                share = valence * weight if ordering == "jacobi" else weight
                total = share[first] + share[second]
                expected = 1 / (total + softness * 0.01 / scene.method.dt**2) if total else 0.0
            assert found[k, i, j] == pytest.approx(expected, rel=1e-14)
