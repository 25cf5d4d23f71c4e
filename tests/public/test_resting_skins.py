"""Skins lay up to a spacing below the floor; and one thickness of a collider has to serve bodies of different spacing.

The skin of a rigid body, of one of tetrahedra, and of a soft one without its elastic sag rest within 2 % of the body's size
of the plane, however it is turned; a run names the bodies that cannot."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.app.output.pieces import pieces_of
from softlab.app.render.bodies.skinning import ClusterFrames
from softlab.model.scene.resting import TOLERANCE, resting_notes
from softlab.model.scene.scene import Scene

TURNED = {"angle": 35.0, "axis": [1.0, 0.3, 0.6]}
GROUND = {"plane": {"static_friction": 0.5, "dynamic_friction": 0.5}, "gravity": {}}


def heights(tables: dict[str, Any], seconds: float) -> dict[str, float]:
    """Of the lowest point of each body's skin after some seconds, over the longest side of the skin at the start."""
    scene = Scene(tables | GROUND)
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        first = skins(scene, simulation.state().position)
        simulation.advance(round(seconds / scene.method.dt))
        last = skins(scene, simulation.state().position)
    return {name: float(last[name][:, 1].min() / np.ptp(first[name], axis=0).max()) for name in first}


def skins(scene: Scene, position: np.ndarray) -> dict[str, np.ndarray]:
    """Of each body, from positions alone."""
    position = np.asarray(position, np.float64)
    matrices = ClusterFrames(scene).of_state(position) if scene.bodies else None
    return {piece.name: piece.vertices for piece in pieces_of(scene, position, matrices)}


def body(kind: str, shape: str, **more: Any) -> dict[str, Any]:
    return {"kind": kind, "shape": {"name": shape}, "origin": [0.0, 0.7, 0.0]} | more


@pytest.mark.parametrize("turn", [{}, TURNED], ids=["upright", "turned"])
@pytest.mark.parametrize("shape", ["star", "blob", "torus"])
def test_rigid_bodies_rest_on_their_skins(shape: str, turn: dict[str, Any]) -> None:
    tables = {"body": body("rigid_body", shape, particle_spacing=0.08, **turn), "damping": {"coefficient": 1.0}}
    assert abs(heights(tables, 3.0)["body"]) < TOLERANCE


@pytest.mark.parametrize("shape", ["star", "blob"])
def test_bodies_of_voxels_that_fall_slantwise_rest_on_their_skins(shape: str) -> None:
    """Colliders meet the corners of voxels, which reach beyond the skin along diagonals by more than 2 %: the body comes to
    rest on a side of its lattice, in which the skin lies."""
    jelly = body("tetrahedral_body", shape, voxels=6, damping=0.01, mass_damping=2.0, **TURNED)
    cooked = Scene({"body": jelly}).parts["body"].cooked  # type: ignore[attr-defined]
    diagonal = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    beyond = (cooked.mesh.position @ diagonal).max() - (cooked.hull_position @ diagonal).max()
    assert beyond > TOLERANCE * np.ptp(cooked.hull_position, axis=0).max()
    assert abs(heights({"body": jelly}, 2.0)["body"]) < TOLERANCE


def test_of_a_soft_body_only_the_elastic_sag_lies_below() -> None:
    """Its skin follows its clusters, of which the lowest particles are pressed up by g over the stiffness: that is in
    proportion to 1 / stiffness, and what is left at 1 / stiffness = 0 is the contact's own."""
    stiffness = np.array([2e3, 4e3, 8e3])
    low = []
    for own in stiffness:
        soft = body("soft_body", "box", particle_spacing=0.25, cluster_stiffness=float(own), cluster_damping=20.0)
        low.append(heights({"body": soft, "damping": {"coefficient": 3.0}}, 3.0)["body"])
    sag = np.diff(low) / np.diff(1 / stiffness)
    assert sag[0] < 0 and sag[1] == pytest.approx(sag[0], rel=0.1)
    rigid = low[2] - sag[1] / stiffness[2]
    assert abs(rigid) < TOLERANCE < -low[0], (low, rigid)


def mixed(bricks: int, jellies: int) -> dict[str, Any]:
    """Bodies whose particles lie on the skin, and others with particles 0.03 m below it."""
    box = {"shape": {"name": "box", "sides": [0.3, 0.12, 0.18]}, "particle_spacing": 0.06, "apart": [0.5, 1.0, 1.0]}
    brick = {"kind": "rigid_body", "origin": [0.0, 0.1, 0.0], "copies": [bricks, 1, 1], "volume_sampling": 0.0} | box
    jelly = {"kind": "rigid_body", "origin": [0.0, 0.1, 1.0], "copies": [jellies, 1, 1], "surface_sampling": 0.0} | box
    return {"brick": brick, "jelly": jelly, "damping": {"coefficient": 1.0}}


OFF = pytest.mark.parametrize(("bricks", "jellies", "off"), [(1, 1, "brick"), (3, 1, "jelly"), (1, 3, "brick")])


def note_of(bricks: int, jellies: int) -> str:
    (note,) = (line for line in resting_notes(Scene(mixed(bricks, jellies) | GROUND)) if "skin rests" in line)
    return note


@OFF
def test_a_thickness_suits_most_bodies_and_a_run_names_the_others(bricks: int, jellies: int, off: str) -> None:
    note = note_of(bricks, jellies)
    assert note.startswith(f"{off}: ") and ("below plane" if off == "jelly" else "above plane") in note
    thickness = Scene(mixed(bricks, jellies) | GROUND).parts["plane"].thickness  # type: ignore[attr-defined]
    assert thickness == pytest.approx(0.03 if off == "brick" else 0.0006)


@OFF
def test_the_named_body_rests_where_the_note_says(bricks: int, jellies: int, off: str) -> None:
    percent = float(re.findall(r"\((\d+) % of its size\)", note_of(bricks, jellies))[0])
    for name, height in heights(mixed(bricks, jellies), 2.0).items():
        wanted = (-percent if off == "jelly" else percent) / 100 if name.startswith(off) else 0.0
        assert height == pytest.approx(wanted, abs=TOLERANCE), name


def test_a_run_is_silent_where_all_bodies_rest_on_their_skins_or_the_thickness_is_stated() -> None:
    alike = {name: table for name, table in mixed(2, 1).items() if name != "jelly"}
    assert not [line for line in resting_notes(Scene(alike | GROUND)) if "skin" in line]
    stated = mixed(1, 1) | GROUND | {"plane": {"thickness": 0.03}}
    assert not [line for line in resting_notes(Scene(stated)) if "skin" in line]


def test_of_a_world_each_member_names_its_own() -> None:
    jelly = body("tetrahedral_body", "box", voxels=2, origin=[0.0, 3.0, 0.0])
    (note,) = (line for line in resting_notes(Scene(mixed(1, 3) | GROUND | {"block": jelly})) if "skin" in line)
    assert note.startswith("brick: ")
