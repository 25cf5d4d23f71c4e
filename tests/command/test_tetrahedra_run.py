"""What `softlab run` says of bodies of tetrahedra."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_cli import command  # noqa: F401  # a fixture
from tetrahedra_scenes import tetrahedra_scene

from softlab.app.command.run_parts import newton_notes
from softlab.app.command.scene_file import scene_toml
from softlab.app.output.files import read_state
from softlab.model.tetrahedra.newton import PER_SOLVE


def test_the_strain_is_of_the_edge_that_is_stretched_most(command: Any, tmp_path: Path) -> None:  # noqa: F811
    scene = tetrahedra_scene("neo-hookean")
    (tmp_path / "bar.toml").write_text(scene_toml(scene), encoding="utf-8")
    done = command(
        f"run {tmp_path / 'bar.toml'} --steps 3 --backend cpu --precision float64 --json --out {tmp_path / 'end.npz'}"
    )
    assert done.status == 0, done.err
    position, (ends, rest) = read_state(tmp_path / "end.npz", scene).position, scene.tetrahedra_set.edges
    length = np.linalg.norm(position[ends[:, 1]] - position[ends[:, 0]], axis=1)
    worst = np.abs(length / rest - 1).max()
    assert worst > 0 and json.loads(done.out)["max_strain"] == pytest.approx(worst, rel=1e-12)


@pytest.mark.parametrize(
    "done, told",
    [
        ((3, 9, 3, 60, 3), False),  # each substep a step
        ((3, 9, 9, 60, 9), False),  # three
        ((10, 20, 10, 0, 0), False),  # at rest: what is left is below rounding, after a matrix
        ((10, 20, 20, 0, 0), True),  # a matrix, and one made again: neither leads anywhere
        ((10, 21, 19, 22, 1), True),  # of the first substep alone
    ],
)
def test_a_solver_that_finds_no_step_says_so(done: tuple[int, ...], told: bool) -> None:
    """(solves, looks, matrices, products, steps), of one that its matrices are no numbers of, and of others."""
    simulation: Any = SimpleNamespace(done=np.array(done))
    report = {field.name: field.read(simulation, None) for field in PER_SOLVE if field.read}
    assert report["newton_steps"] == pytest.approx(done[4] / done[0])
    assert bool(newton_notes(report)) == told and newton_notes({}) == []
