"""Long-range attachments are as long as the springs between a mass and its anchor, whatever `grid.spacing` they begin at."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from softlab.model.core.build import build
from softlab.model.position_based.attachments import sheet_reaches
from softlab.model.scene.scene import Scene

STIFFNESS, STRETCH = 40.0, 9.81 * 0.01 / 40.0  # N/m, m: of one spring by the weight of one mass


def hanging(spacing: float, rest: float, slack: float, ordering: str, **springs: Any) -> Scene:
    """A mass of 10 g on one spring below a pin."""
    return Scene({
        "grid": {"rows": 2, "columns": 1, "spacing": spacing, "pinned": "top"}, "gravity": {},
        "springs": {"stiffness": STIFFNESS, "rest_length": rest} | springs, "damping": {"coefficient": 0.05},
        "attachments": {"slack": slack}, "method": {"solver": "xpbd", "dt": 0.01, "ordering": ordering},
    })  # fmt: skip


@pytest.mark.parametrize("ordering", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize(
    ("spacing", "rest", "slack", "hangs"),
    [
        (0.5, 1.0, 0.01, 1.0 + STRETCH), (0.5, 1.0, 0.0, 1.0), (0.5, 1.0, 0.001, 1.001), (1.0, 0.5, 0.0, 0.5 + STRETCH),
        (1.0, 1.0, 0.001, 1.001),
    ],
)  # fmt: skip
def test_a_mass_hangs_where_its_spring_holds_it(
    run: Callable[..., Any], kernel: str, ordering: str, spacing: float, rest: float, slack: float, hangs: float
) -> None:
    """Two masses, begun 0.5 m apart on a spring of 1 m, hung at 0.5 m. The attachment holds at (1 + slack) of the rest
    length and not before; where it does not hold, the spring is stretched by m g / k. What damping leaves of a swing after
    2.5 s: exp(-c t / (2 m)) of half a metre."""
    state = run(hanging(spacing, rest, slack, ordering), 250, kernel=kernel)
    assert state.position[1, 1] == pytest.approx(-hangs, abs=0.5 * np.exp(-0.05 * 2.5 / (2 * 0.01)))
    held = (1 + slack) * max(rest, spacing)
    assert np.abs(state.position[1, 1]) <= held * (1 + 4 * np.finfo(float).eps)


@pytest.mark.parametrize(("springs", "scale"), [({}, 1.0), ({"compliance": 0.0}, 0.5)])
def test_springs_that_give_may_begin_stretched(springs: dict[str, Any], scale: float) -> None:
    """Between pins they stay so at rest; inextensible ones must not be."""
    scene = hanging(1.0, 0.5, 0.0, "jacobi", **springs)
    anchor, reach = sheet_reaches(scene, build(scene), np.float64)
    np.testing.assert_array_equal(anchor.ravel(), 0)
    np.testing.assert_array_equal(reach.ravel(), [0.0, scale])
