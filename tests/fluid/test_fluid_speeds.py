"""The speed limit of a fluid, half a support a substep: what is expected, what is counted, what a run says."""

from __future__ import annotations

import json
from math import sqrt
from pathlib import Path
from typing import Any

import pytest
from test_cli import command  # noqa: F401  # a fixture

from softlab.app.command.run_parts import SLOWED, fluid_notes
from softlab.app.command.scene_file import scene_toml
from softlab.app.driver import open_simulation
from softlab.model.fluid.speeds import expected_speeds, speed_lines
from softlab.model.scene.scene import Scene

D = 0.005  # m


def column(high: float = 0.1, **water: Any) -> Scene:
    """Water over a floor that lies as far below as it is high."""
    tables = {
        "kind": "fluid", "dimensions": 2, "rest_distance": D, "size": [4 * D, high], "origin": [0.0, high],
    }  # fmt: skip
    return Scene({"water": tables | water, "gravity": {}, "floor": {"kind": "plane"}, "method": {"solver": "pbf"}})


def test_a_fall_and_a_start_are_expected() -> None:
    """sqrt(2 g H) from the water's top to the floor; a start that is faster counts."""
    scene = column()
    assert expected_speeds(scene)["water"][0] == pytest.approx(sqrt(2 * scene.gravity.acceleration * 0.2))
    assert expected_speeds(column(velocity=[3.0, 4.0, 0.0]))["water"][0] == pytest.approx(5.0)


def test_a_note_names_substeps_that_do() -> None:
    """With those substeps, or a limit that was asked for, there is no note."""
    (line,) = speed_lines(column())
    substeps = int(line.split("method.substeps = ")[1].split()[0])
    assert not speed_lines(column().replace({"method.substeps": substeps}))
    assert speed_lines(column().replace({"method.substeps": substeps - 1}))
    assert not speed_lines(column(maximum_speed=0.1))


@pytest.mark.parametrize("scheme", ["macklin", "divergence-free"])
def test_it_is_counted(scheme: str) -> None:
    """Each particle that is too fast, in each substep; none that is not."""
    for speed, wanted in ((2.0, 1), (0.01, 0)):
        scene = column(4 * D, origin=[0.0, 1.0], velocity=[0.0, -speed, 0.0]).replace({"method.scheme": scheme})
        with open_simulation(scene, "cpu", precision="float32", threads=1) as simulation:
            simulation.advance(1)
            count = scene.fluid_set.particle_count * scene.method.substeps
            assert simulation.speed_limited == wanted * count  # type: ignore[attr-defined]


def test_a_run_says_so(command: Any, tmp_path: Path) -> None:  # noqa: F811
    (tmp_path / "fall.toml").write_text(scene_toml(column(velocity=[0.0, -2.0, 0.0])), encoding="utf-8")
    done = command(f"run {tmp_path / 'fall.toml'} --steps 1 --backend cpu --json")
    told = json.loads(done.out)
    assert told["speed_limited"] > 0 and told["speed_limit"] == pytest.approx(
        0.5 * D / 0.55 / told["dt"] * told["substeps"]
    )
    words = command(f"run {tmp_path / 'fall.toml'} --steps 1 --backend cpu")
    assert "no particle goes faster than" in words.out + words.err and "slowed a particle" in words.out + words.err


def test_a_run_says_so_above_a_share_of_the_moves() -> None:
    scene, steps = column(), 1000
    moves = scene.grid.particle_count * scene.method.substeps * steps
    report = {"steps": steps, "speed_limit": 1.0}
    assert not fluid_notes(scene, report | {"speed_limited": int(SLOWED * moves)})
    (note,) = fluid_notes(scene, report | {"speed_limited": moves // 50})
    assert "2 % of all moves" in note
