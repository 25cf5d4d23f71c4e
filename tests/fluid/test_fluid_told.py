"""What a run and the window say of a fluid: its density error, in place of a strain that it has not."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fluid_scenes import column_scene
from test_cli import command  # noqa: F401  # a fixture

from softlab.app.command.scene_file import scene_toml
from softlab.app.driver import open_simulation
from softlab.app.families import fluid
from softlab.app.output.files import read_state
from softlab.app.window.demo_report import strain_text
from softlab.app.window.measures import Statistics, measure
from softlab.model.fluid.measure import compression


def test_a_run_tells_a_density_error_and_no_strain(command: Any, tmp_path: Path) -> None:  # noqa: F811
    scene = column_scene()
    (tmp_path / "column.toml").write_text(scene_toml(scene), encoding="utf-8")
    line = f"run {tmp_path / 'column.toml'} --steps 2 --backend cpu --precision float64"
    done = command(f"{line} --json --out {tmp_path / 'end.npz'}")
    assert done.status == 0, done.err
    told = json.loads(done.out)
    mean, largest = compression(scene, read_state(tmp_path / "end.npz", scene).position)
    assert told["max_strain"] is None and largest > 0
    assert (told["mean_compression"], told["largest_compression"]) == pytest.approx((mean, largest), rel=1e-9)
    words = command(line).out
    assert "max strain" not in words and "density error, mean" in words and "density error, largest" in words


def test_the_window_tells_the_largest_density_error(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = column_scene()
    with open_simulation(scene, precision="float64") as simulation:
        simulation.advance(1)
        place = simulation.read("position")
        found = measure([simulation], 0, [place], Statistics())
        demo: Any = SimpleNamespace(statistics=found, world=simulation)
        assert found.worst_strain == compression(scene, place)[1] > 0
        assert strain_text(demo).startswith(f"largest density error {found.worst_strain:+.2%}, fastest ")
        monkeypatch.setattr(fluid, "MAX_MEASURED", len(place) - 1)
        demo.statistics = measure([simulation], 0, [place], Statistics())
        fastest = np.linalg.norm(simulation.state().velocity, axis=1).max()
        assert strain_text(demo) == f"fastest {fastest:.3g} m/s"
