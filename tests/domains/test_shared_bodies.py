"""Bodies that never meet, in shares: what is done to them reaches their share (bits: test_shares.py)."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from shares import same

from softlab.app.driver import open_simulation
from softlab.cpu_backend.domains.in_threads import run_in_threads
from softlab.cpu_backend.domains.ranks import RankBodies
from softlab.model.core.options import Options
from softlab.model.core.sharing.bodies import Apart, divide
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

BOX = {"shape": {"name": "box", "sides": [0.2, 0.2, 0.2], "resolution": 2}, "particle_spacing": 0.1}
PLANE = {"kind": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0], "velocity": [0.0, 0.1, 0.0]}
METHOD = {"solver": "shape-matching", "dt": 0.01, "substeps": 1, "iterations": 1}
SOFT = {"kind": "soft_body", **BOX, "cluster_stiffness": 4000.0, "velocity": [0.3, -2.0, 0.0], "spin": [1.0, 2.0, 3.0]}
BODIES: dict[str, dict[str, Any]] = {  # of every kind and material, in an order that mixes those of lattices with others
    "soft": SOFT | {"copies": [2, 1, 1]},
    "block": {"kind": "soft_lattice", **BOX, "region": 1, "cluster_stiffness": 4000.0, "copies": [2, 1, 1]}
    | {"velocity": [0.0, -1.0, 0.5]},
    "rigid": {"kind": "rigid_body", **BOX, "velocity": [0.0, -3.0, 0.0], "spin": [3.0, 0.0, 1.0]},
    "clay": SOFT | {"linear": 0.5, "plastic_threshold": 0.01, "plastic_creep": 50.0, "plastic_limit": 0.4}
    | {"cluster_damping": 5.0},
    "sheet": {"kind": "soft_sheet", "shape": {"name": "sheet", "resolution": 3, "scale": 0.3}}
    | {"particle_spacing": 0.1, "link_stiffness": 1000.0, "velocity": [0.0, -1.0, 0.0], "spare": 1},
}  # fmt: skip


def scene_of(*names: str, **more: Any) -> Scene:
    """Those bodies, a little above the ground, which comes up to meet them."""
    parts = {name: BODIES[name] | {"origin": [1.5 * n, 0.14, 0.0]} for n, name in enumerate(names or BODIES)}
    return Scene({**parts, "ground": PLANE | {"restitution": 0.5}, "gravity": {}, "method": METHOD} | more)


def driven(simulation: Any, poked: int) -> tuple[State, np.ndarray, np.ndarray]:
    """Everything a user may do to bodies while they move; where clusters are in the end."""
    with simulation:
        simulation.poke(poked, (300.0, 0.0, 0.0))
        simulation.advance(2)
        simulation.set("gravity.enabled", False)
        simulation.set("method.dt", 0.004)
        simulation.poke(None)
        simulation.add_body("sheet", (0.0, 2.0, 0.0), (0.0, 1.0, 0.0))
        simulation.remove_body(0)
        simulation.advance(3)
        kept = simulation.state()
        simulation.advance(2)
        simulation.load(kept)
        simulation.advance(1)
        return simulation.state(), simulation.read("deformation"), simulation.read("centre")


def test_what_is_done_to_bodies_reaches_their_shares() -> None:
    """A force on a particle of the second share, gravity and the step size while they fall, one that comes and one that goes,
    a state that is loaded."""
    scene, live = scene_of("soft", "clay", "sheet"), frozenset({"poke", "gravity", "dt"})
    poked = scene.body_set.copies[2].first_particle + 1
    one = driven(open_simulation(scene, threads=1, math="exact", live=live), poked)
    options = Options(math="exact", live=live)
    for found in run_in_threads(2, lambda ranks: driven(RankBodies(scene, options, ranks, 1), poked), patience=60):
        assert same(found[0], one[0])
        assert all(mine.tobytes() == other.tobytes() for mine, other in zip(found[1:], one[1:], strict=True))


@given(st.lists(st.integers(1, 10_000), min_size=1, max_size=40), st.data())
@settings(deadline=None, max_examples=50)
def test_no_share_is_heavier_than_a_fair_one_and_a_body(weights: list[int], data: st.DataObject) -> None:
    """Each cut is at most half of the heaviest body from where it would be fair, unless a share would be empty there, which
    then has one body. All bodies are owned once, in their order."""
    count = data.draw(st.integers(1, len(weights)))
    firsts = np.concatenate([[0], np.cumsum(weights)])
    apart = Apart(
        ("it",) * len(weights),
        np.array(weights),
        "particles",
        firsts,
        "",
        lambda first, end: None,
        lambda first, end: firsts,
    )
    shares = divide(apart, count, "--gpus").blocks
    assert [n for share in shares for n in range(share.first, share.end)] == list(range(len(weights)))
    assert all(share.end > share.first and share.weight == sum(weights[share.first : share.end]) for share in shares)
    assert max(share.weight for share in shares) <= sum(weights) / count + max(weights)
