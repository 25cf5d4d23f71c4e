"""The hard cases judged again: what must hold of an end state, from the collection's own words, in NumPy, with neither the
laws of bench/stress/laws.py nor the references they ask. B5 to B7, B10: a grid of springs at rest; closed forms of A4 and of
half of gravity; what was found and published."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.model.scene.scene import Scene

FORCE = 1e-9  # N, left on a free mass at rest, in float64
PINS = {"top": np.s_[:1], "top-corners": np.s_[:1, [0, -1]], "none": np.s_[:0]}  # of (rows, columns)
# The loosest bound that each judged number may have been held to, in float64: docs/method/cases.md and the cases' own words.
BOUNDS: dict[str, tuple[str, float]] = {
    "overflow reported at step": ("<", 201),
    "limit named, from the stiff springs'": ("<", 1e-9),
    "distance from the hanging chain over its stretch": ("<", 0.01),
    "distance from the reference": ("<", 1e-11),
    "way of the pinned masses": ("<", 1e-30),
    "largest coordinate": ("<", 1e3),
    "residual force": ("<", FORCE),
    "speed": ("<", 0.05),  # of B12; of what comes to rest 1e-9, see `judged_anew`
    "bottom row's highest point": ("<", 0.0),
    "growth of the fastest mode": ("<>", 1.0),
    "energy lost within 1 s": (">", 0.0),
    "bottom row from its place under half of gravity": ("<", 1e-3),
    "lowest mass from y = -19.48": ("<", 0.02),
    "bottom mass from free fall": ("<", 1e-9),
    "distance from the run at the origin": ("<", 20.0),
    "largest coordinate over its start": ("<", 100.0),
    "of 14 masses in its way passed by the ball": ("<", 1),
    "deepest mass inside the ball": ("<", 1e-12),
    "energy seen from the ball over the start's": ("<", 1.1),
    "energy gained": ("<", 0.4),
    "largest speed": ("<", 6.0),
}


def net_force(scene: Scene, position: np.ndarray) -> np.ndarray:
    """(rows, columns, 2) [N]: every spring by itself, and gravity; on pinned masses 0."""
    grid, springs = scene.grid, scene.springs
    assert springs is not None
    p = position.reshape(grid.rows, grid.columns, 2)
    force = np.zeros_like(p)
    if scene.gravity and scene.gravity.enabled:
        force[..., 1] -= grid.mass * scene.gravity.acceleration
    for i in range(grid.rows):
        for j in range(grid.columns):
            for k, l in ((i, j + 1), (i + 1, j)):  # noqa: E741
                if k < grid.rows and l < grid.columns:
                    way = p[k, l] - p[i, j]
                    length = np.hypot(*way)
                    pull = springs.stiffness * (length - springs.rest_length) * way / length if length > 0 else 0 * way
                    force[i, j] += pull
                    force[k, l] -= pull
    force[PINS[str(grid.pinned)]] = 0
    return force


def at_rest(scene: Scene, end: np.ndarray) -> None:
    assert np.abs(net_force(scene, end)).max() < FORCE
    assert not end.reshape(scene.grid.rows, -1, 2)[PINS[str(scene.grid.pinned)]][..., 1].any()  # held


def hangs_down(scene: Scene, end: np.ndarray) -> None:
    at_rest(scene, end)
    assert end[-scene.grid.columns :, 1].max() < 0


def hangs_by_half(scene: Scene, end: np.ndarray) -> None:
    """Nine links, the k-th from below carrying k masses at 9.81 / 2 m/s^2: 1 + k m g / 2 k each."""
    grid = scene.grid
    lengths = 1 + np.arange(1, grid.rows) * grid.mass * 9.81 / 2 / scene.springs.stiffness  # type: ignore[union-attr]
    assert np.abs(end[-grid.columns :, 1] + lengths.sum()).max() < 1e-3


def ends_low(scene: Scene, end: np.ndarray) -> None:
    assert abs(end[:, 1].min() + 19.48) < 0.02


def stays_tiny(scene: Scene, end: np.ndarray) -> None:
    assert 0 < np.abs(end).max() < 100e-310


def is_folded(scene: Scene, end: np.ndarray) -> None:
    at_rest(scene, end)
    assert np.abs(end).max() < 1e3


ENDS: dict[str, Callable[[Scene, np.ndarray], None]] = {
    "B5 line": is_folded, "B5 disturbed": at_rest, "B5 point": at_rest, "B6": hangs_down, "B7 mirrored": at_rest,
    "B7 random": at_rest, "B10 100": at_rest, "B10 1000": at_rest, "B10 drag": at_rest, "B11": hangs_by_half,
    "B12": ends_low, "B15": stays_tiny,
}  # fmt: skip


def judged_anew(case: str, scene: Scene, verdict: str, checks: list, end: np.ndarray | None) -> None:
    """Assert that the verdict follows from the numbers, that their bounds are no looser than told, and that the end state by
    itself bears it out. `checks`: of bench.stress.trial.Check."""
    bounded = [check for check in checks if check.relation in ("<", ">")]
    missed = [c for c in bounded if not (c.value < c.bound if c.relation == "<" else c.value > c.bound)]
    if verdict == "pass":
        assert bounded and not missed, missed
    if verdict == "known":
        assert missed
    for check in bounded:
        relation, loosest = BOUNDS[check.name]
        assert check.relation in relation
        assert check.bound <= loosest if check.relation == "<" else check.bound >= loosest, check
        if check.name == "speed" and case != "B12":
            assert check.bound <= 1e-9
    if verdict == "pass" and case in ENDS:
        assert end is not None and np.isfinite(end).all()
        ENDS[case](scene, end)
