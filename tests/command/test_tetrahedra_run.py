"""What `softlab run` says of bodies of tetrahedra."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_cli import command  # noqa: F401  # a fixture
from tetrahedra_scenes import tetrahedra_scene

from app.command.scene_file import scene_toml
from app.output.files import read_state


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
