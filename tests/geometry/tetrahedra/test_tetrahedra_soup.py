"""Meshes of every kind, good and bad, made from a seed, through voxel_mesh and cook: a body whose laws hold, or one line.

A case is told by its number, and made again from that alone. 200 by default; 10 000 with --rest or --thorough.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from closed_meshes import ball, both, box, rotation, turned_over

from softlab.model.assets.cooked import cooked
from softlab.model.assets.tetrahedral_body import CookedBody
from softlab.model.base.errors import InputError, SoftlabError
from softlab.model.geometry.tetrahedra.voxels import voxel_mesh

SEED, FEW, MANY = 16, 200, 2_000


def mesh_of(chance: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A mesh that is closed to begin with, or a heap of triangles, and what may become of it."""
    makers = [
        lambda: ball(float(chance.uniform(0.2, 2)), int(chance.integers(0, 4))),
        lambda: box(chance.uniform(0.01, 2, 3), chance.normal(size=3)),
        lambda: box(chance.integers(1, 4, 3), chance.integers(-2, 3, 3)),  # which the lattice meets at its corners
        lambda: (np.round(chance.normal(size=(12, 3)), int(chance.integers(0, 3))), chance.integers(0, 12, (20, 3))),
        lambda: (chance.normal(size=(4, 3)), np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])),
    ]
    mesh = makers[chance.choice(5, p=[0.3, 0.25, 0.25, 0.1, 0.1])]()
    while chance.random() < 0.3:
        other = makers[chance.integers(3)]()
        near = other[0] * chance.choice([1.0, 0.5]) + chance.normal(size=3) * chance.choice([0.0, 0.3, 2.0])
        mesh = both(mesh, (near, other[1]))
    for _ in range(chance.integers(0, 4)):
        mesh = changed(chance, *mesh)
    return mesh


def changed(chance: np.random.Generator, position: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    position, triangles = np.array(position, dtype=float), np.array(triangles)
    some = chance.integers(0, max(1, len(triangles)), int(chance.integers(1, 4)))
    with np.errstate(all="ignore"):
        match chance.integers(17):
            case 0 if len(triangles):  # open
                triangles = np.delete(triangles, some, axis=0)
            case 1 if len(triangles):  # triangles twice, or the other way round
                triangles = np.concatenate([triangles, triangles[some][:, chance.permutation(3)]])
            case 2:  # crumpled: it crosses itself
                position += chance.normal(size=position.shape) * chance.choice([0.01, 0.2, 1.0])
            case 3:
                position, triangles = turned_over((position, triangles))
            case 4:  # flat, or nearly
                position[:, chance.integers(3)] *= chance.choice([0.0, 1e-15, 1e-9, 1e-4])
            case 5:
                position *= 10.0 ** chance.choice([-300, -100, -12, -6, 6, 9, 12, 100, 300])
            case 6:
                position += chance.normal(size=3) * 10.0 ** chance.integers(0, 14)
            case 7 if len(position):
                position[chance.integers(len(position)), chance.integers(3)] = chance.choice(
                    [np.nan, np.inf, -np.inf, 1e308]
                )
            case 8:  # every triangle by itself
                position, triangles = position[triangles.ravel()], np.arange(triangles.size).reshape(-1, 3)
            case 9:
                position = np.round(position * 4) / 4
            case 10:
                position = position @ rotation(chance.normal(size=3)).T
            case 11:  # no vertices, or no triangles
                position, triangles = (
                    (position, triangles[:0]) if chance.random() < 0.5 else (position[:0], triangles[:0])
                )
            case 12 if len(triangles):  # corners that are one
                triangles[some, 0] = triangles[some, 1]
            case 13 if len(triangles):  # vertices pulled together
                position[triangles[some, 0]] = position[triangles[some, 1]]
            case 14 if len(triangles):  # some of it turned over
                triangles[some] = triangles[some][:, ::-1]
            case 15:  # the same again, beside it
                gap = np.ptp(position, axis=0) * 1.02 if len(position) else np.zeros(3)
                position, triangles = both((position, triangles), (position + gap * [1, 0, 0], triangles))
            case 16:  # a shell
                inner = position * 0.7 if chance.random() < 0.5 else position * [1, 1, 0.5]
                position, triangles = both((position, triangles), turned_over((inner, triangles)))
    return position, triangles


def laws(body: CookedBody, position: np.ndarray) -> None:
    mesh, carrier = body.mesh, body.embedding
    assert (mesh.volumes > 0).all() and ((mesh.quality > 0) & (mesh.quality <= 1)).all()
    assert np.isfinite(mesh.position).all() and len(carrier.weights) == len(body.hull_position)
    size = max(float(np.abs(position).max()), body.report.edge)
    away = carrier.points(mesh.position, mesh.tetrahedra) - body.hull_position
    assert np.abs(away).max() <= 1e-12 * size
    assert np.abs(carrier.weights.sum(axis=1) - 1).max() < 1e-12 * max(1, size / body.report.edge)
    outside = np.flatnonzero(carrier.beyond(mesh.position, mesh.tetrahedra) > 1e-9 * size)
    corners = body.hull_position[body.hull_triangles[np.isin(body.hull_triangles, outside).any(axis=1)]]
    assert (
        np.ptp(corners, axis=1).min(axis=1) <= 1e-9 * size
    ).all()  # points of fins without a thickness, on the lattice
    group = np.repeat(np.arange(len(body.starts) - 1), np.diff(body.starts))
    for colour in range(8):
        those = body.colour == colour
        owner = np.full(len(mesh.position), -1)
        owner[mesh.tetrahedra[those]] = group[those][:, None]
        assert (owner[mesh.tetrahedra[those]] == group[those][:, None]).all()
    assert body.report.lines()


def soup(first: int, last: int, folder) -> tuple[int, int]:
    """(bodies, refusals) of those cases; fails with all that went wrong."""
    bodies, wrong = 0, []
    for case in range(first, last):
        chance = np.random.default_rng([SEED, case])
        position, triangles = mesh_of(chance)
        per_voxel = 5 if chance.random() < 0.7 else 6
        size = {"voxels": int(chance.integers(1, 13))}
        if chance.random() < 0.2:
            size = {"edge": float(10.0 ** chance.uniform(-3, 1))}
        keep = chance.random() < 0.1
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # as the command line does: what overflows is refused
                if chance.random() < 0.5:
                    body = cooked((position, triangles), per_voxel=per_voxel, use_cache=keep, folder=folder, **size)
                    laws(body, position)
                else:
                    assert (voxel_mesh((position, triangles), per_voxel=per_voxel, **size).mesh.volumes > 0).all()
            bodies += 1
        except SoftlabError as error:
            line = str(error)
            if (
                "\n" in line
                or len(line) > 600
                or not (isinstance(error, InputError) or "edge" in line or "voxels" in line)
            ):
                wrong.append(f"case {case}: {line}")
        except Exception as error:
            wrong.append(f"case {case}: {type(error).__name__}: {error}"[:200])
    assert not wrong, f"{len(wrong)} of {last - first}\n" + "\n".join(wrong[:20])
    return bodies, last - first - bodies


@pytest.fixture(autouse=True)
def little_memory(monkeypatch):
    """So that voxels are refused which would fit into this machine, and take minutes."""
    monkeypatch.setattr("softlab.model.geometry.tetrahedra.voxels.available_bytes", lambda: 1 << 26)


def test_a_soup_of_meshes(tmp_path):
    bodies, refused = soup(0, FEW, tmp_path)
    assert bodies > FEW // 5 and refused > FEW // 5  # some of it is good


def test_two_thousand_meshes(tmp_path):
    """For --rest and --thorough (tests/tiers.py); of the first ten thousand all kept the laws."""
    soup(FEW, FEW + MANY, tmp_path)
