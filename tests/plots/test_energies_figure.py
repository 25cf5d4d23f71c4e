"""The figure of a trajectory's energies."""

import json
from pathlib import Path

import numpy as np
import pytest

from softlab.model.base.errors import InputError
from softlab.model.core.energy import energies
from softlab.model.scene.scene import load_scene
from softlab.plots.figures.energies import draw_energies, read_energies

# ---------------------------------------------------------------------- energies


@pytest.fixture
def trajectory(tmp_path: Path) -> Path:
    """Free fall of a 3 x 4 grid at rest length: x = -g t^2 / 2, v = -g t; the total stays, the springs hold nothing."""
    scene = load_scene("lab-grid").replace(
        {"grid.rows": 3, "grid.columns": 4, "grid.pinned": "none", "method.integrator": "velocity-verlet"}
    )
    from softlab.model.core.build import rest_positions

    time = np.linspace(0, 1, 5)
    position = np.repeat(rest_positions(scene.grid)[None], 5, axis=0)
    velocity = np.zeros_like(position)
    position[:, :, 1] -= 0.5 * 9.81 * time[:, None] ** 2
    velocity[:, :, 1] = -9.81 * time[:, None]
    path = tmp_path / "traj.npz"
    text = json.dumps(scene.as_dict())
    np.savez(path, position=position, velocity=velocity, time=time, step=np.arange(5), scene=text)
    return path


def test_energies_of_free_fall(trajectory: Path) -> None:
    record = read_energies(trajectory)
    assert record.kinetic == pytest.approx(0.5 * 12 * 0.01 * (9.81 * record.time) ** 2)
    assert record.total == pytest.approx(np.full(5, record.total[0]), rel=1e-12)
    assert record.spring == pytest.approx(np.zeros(5), abs=1e-20)  # rounding of the rest positions
    with np.load(trajectory) as file:
        assert record.gravity[-1] == energies(record.scene, file["position"][-1], file["velocity"][-1])["gravity"]


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_energies_are_drawn(trajectory: Path, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"energies.{suffix}"
    assert draw_energies(trajectory, out) == out
    assert out.stat().st_size > 1000


def test_trajectories_that_cannot_be_read(trajectory: Path, tmp_path: Path) -> None:
    text, half, other = tmp_path / "text.npz", tmp_path / "half.npz", tmp_path / "other.npz"
    text.write_text("no numbers")
    np.savez(half, time=np.arange(3.0))
    with np.load(trajectory) as file:
        np.savez(other, **{**file, "position": file["position"][:, :5]})
    for path, reason in (
        (tmp_path / "none.npz", "no such file"),
        (text, "cannot be read as a .npz file"),
        (half, "lacks step, position"),
        (other, "position has shape"),
        (tmp_path, "is a directory"),
    ):
        with pytest.raises(InputError, match=reason):
            draw_energies(path, tmp_path / "out.png")
    with pytest.raises(InputError, match="name it so"):
        draw_energies(trajectory, tmp_path / "out.jpg")
    with pytest.raises(InputError, match="no such folder"):
        draw_energies(trajectory, tmp_path / "missing" / "out.png")
    assert not (tmp_path / "out.png").exists()
