"""Clusters that no mesh produces, for laws and tests: flat ones, lines, pairs and points, given by their members."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from softlab.bench.experiments.body_scenes import SAMPLED, bodies_scene
from softlab.model.assets.clusters import Clusters
from softlab.model.particles.body_set import BodySet, Copy
from softlab.model.particles.links import LinkedCopies, make_links
from softlab.model.scene.scene import Scene

BODY = {"kind": "rigid_body", "particle_spacing": 0.14, **SAMPLED}  # the body that they replace


def by_hand(clusters: Clusters, links: Sequence[LinkedCopies] = (), **tables: Any) -> Scene:
    """Return a scene whose body set is these clusters and links, as one body."""
    scene = bodies_scene(**{"body": BODY, "gravity": 0.0, **tables})
    copies = (Copy("body", SimpleNamespace(clusters=clusters, lattice=None), 0, 0, 0),)  # type: ignore[arg-type]
    at, count = clusters.position, len(clusters.mass)
    zero, body = np.zeros_like(at), np.zeros(count, np.int32)
    scene.__dict__["body_set"] = BodySet(
        at, zero, body, clusters, make_links(links), copies, 0.1, float(clusters.mass.mean())
    )
    scene.canonical = lambda: f"by hand {id(clusters)}"  # type: ignore[method-assign]  # key of its cached arrays
    return scene


def clusters_of(
    position: ArrayLike,
    members: Iterable[Sequence[int] | np.ndarray],
    stiffness: ArrayLike = np.inf,
    mass: ArrayLike | None = None,
) -> Clusters:
    """Return clusters at `position`; each of `members` lists the particles of a cluster."""
    members = list(members)
    at, sizes = np.asarray(position, dtype=np.float64), [len(one) for one in members]
    return Clusters(
        np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32), np.concatenate(members).astype(np.int32),
        np.ones(sum(sizes)), np.full(len(members), stiffness, float) if np.isscalar(stiffness) else np.asarray(stiffness),
        np.ones(len(at)) if mass is None else np.asarray(mass, dtype=np.float64), at,
    )  # fmt: skip


def degenerate() -> Clusters:
    """Return flat and collinear clusters, clusters of one particle, of two, of none, of coincident ones, and an
    unclustered particle.
    """
    flat = [[x, y, 0.0] for x in range(3) for y in range(3)]
    line, one, two = [[3.0 + n, n, n] for n in range(4)], [[9.0, 0.0, 0.0]], [[11.0, 0.0, 0.0], [11.0, 1.0, 1.0]]
    place, orphan = [[14.0, 0.0, 0.0]] * 3, [[16.0, 0.0, 0.0]]
    groups = [flat, line, one, two, [], place]
    ends = np.cumsum([0, *(len(group) for group in groups)])
    members = [np.arange(a, b) for a, b in pairwise(ends)]
    return clusters_of(np.array([*flat, *line, *one, *two, *place, *orphan]) * 0.1, members)
