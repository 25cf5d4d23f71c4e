"""Skins and frames of bodies follow their clusters, at the start, bent and turned; what a solver is asked for them."""

from __future__ import annotations

import numpy as np
from closed_meshes import rotation
from fake_cloth import FakeCloth
from real_window import StillWindow, display, needs_display  # noqa: F401
from test_bodies_view import BENT, BODY_SET, SCENE
from test_view3d import drawing, looks_like, near  # noqa: F401  # a fixture among them

from softlab.app.render.bodies.skinning import ClusterFrames, of_quaternions

RANDOM = np.random.default_rng(6)


def skin_of(number: int, matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(position, normal) (vertices, 3) of a copy's skin, as the shader makes them of the clusters' matrices."""
    copy = BODY_SET.copies[number]
    skin, own = copy.baked.skin, matrices[copy.first_cluster :].astype(np.float64)
    rows = np.einsum("vk,vkij->vij", skin.weights, own[skin.clusters])
    normal = np.einsum("vij,vj->vi", rows[:, :, :3], skin.normal)
    return np.einsum("vij,vj->vi", rows[:, :, :3], skin.position) + rows[:, :, 3], normal


# ---------------------------------------------------------------------- skins


def test_at_the_start_every_skin_is_its_mesh_turned_and_moved() -> None:
    matrices = ClusterFrames(SCENE).of_state(BODY_SET.position)
    placed = [(part, place) for part in SCENE.bodies.values() for place in part.places()]
    for number, (part, place) in enumerate(placed):
        skin = part.baked.skin
        position, normal = skin_of(number, matrices)
        np.testing.assert_allclose(position, skin.position @ part.turn().T + place, atol=1e-6)  # rounding of metres
        np.testing.assert_allclose(normal, skin.normal @ part.turn().T, atol=1e-6)


def test_a_bent_skin_is_that_of_the_model() -> None:
    """The clusters' rotations, then the copy's own turn, as model/assets/skin.py takes them, in float64."""
    matrices = ClusterFrames(SCENE).of_state(BENT)
    centre, turned = BODY_SET.clusters.centres(BENT), BODY_SET.clusters.rotations(BENT)
    for copy in BODY_SET.copies:
        own = slice(copy.first_cluster, copy.first_cluster + copy.baked.clusters.count)
        whole = turned[own] @ SCENE.bodies[copy.name].turn()
        position, normal = copy.baked.skin.skinned(centre[own], whole)
        drawn, outward = skin_of(copy.number, matrices)
        np.testing.assert_allclose(drawn, position, atol=2e-6)
        length = np.linalg.norm(outward, axis=1, keepdims=True)
        np.testing.assert_allclose(outward / length, normal, atol=1e-5)  # cancelled parts of means are longer than they


def test_quaternions_of_a_solver_are_its_rotations() -> None:
    turns = RANDOM.normal(0, 2, (20, 3))
    angle = np.linalg.norm(turns, axis=1, keepdims=True)
    quaternions = np.hstack([np.cos(angle / 2), np.sin(angle / 2) * turns / angle])
    np.testing.assert_allclose(of_quaternions(quaternions), [rotation(turn) for turn in turns], atol=1e-14)


class Telling(FakeCloth):
    """Bodies that tell of their clusters, by quaternions."""

    view_options = 0

    def _read_clusters(self) -> tuple[np.ndarray, np.ndarray]:
        self.view_options += 1
        matrices = BODY_SET.clusters.rotations(self._position)
        w = np.sqrt(1 + np.trace(matrices, axis1=1, axis2=2)) / 2  # turned by less than half a turn
        axis = np.stack([matrices[:, 2, 1] - matrices[:, 1, 2], matrices[:, 0, 2] - matrices[:, 2, 0],
                         matrices[:, 1, 0] - matrices[:, 0, 1]], axis=1)  # fmt: skip
        return np.hstack([w[:, None], axis / (4 * w[:, None])]), BODY_SET.clusters.centres(self._position)


def test_a_solver_is_asked_for_its_clusters_and_its_state_is_enough() -> None:
    frames = ClusterFrames(SCENE)
    for kind in (FakeCloth, Telling):
        simulation = kind(SCENE)
        simulation._position = BENT.copy()
        found = frames.of_simulation(simulation, BENT)
        np.testing.assert_allclose(found, frames.of_state(BENT), atol=1e-6)
        assert (
            simulation.asked == [] and getattr(simulation, "looks", 1) == 1
        )  # at the state that the caller gave, or once
