"""Bodies that come and go: what waits changes nothing, what comes in falls as if it had been there, what leaves is gone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies_scenes import BAR, BRICK, bodies_scene, end_state, method, opened, same

from softlab.app.output.files import read_state, write_state
from softlab.model.base.errors import InputError, SceneError
from softlab.model.scene.scene import Scene

CONTACT: dict[str, Any] = {"contact": {}}


def world(spare: int, **parts: Any) -> Scene:
    """A soft bar and a brick over the ground, and bricks that wait."""
    brick = BRICK | {"origin": [0.0, 0.5, 0.0], "spare": spare}
    return bodies_scene(
        bar=BAR | {"origin": [0.0, 0.15, 0.0]}, brick=brick, damping=0.1,
        plane={"point": [0.0, 0.0, 0.0], "thickness": 0.03}, method=method(2, 1), **parts,
    )  # fmt: skip


@pytest.mark.parametrize("kernel,threads", [("fused", 3), ("fused", 1), ("stages", 2)])
@pytest.mark.parametrize("parts", [CONTACT, {}], ids=["contacts", "clusters"])
def test_what_waits_changes_no_bit(parts: dict[str, Any], kernel: str, threads: int) -> None:
    """Of the others; and stays where it is, to the rounding of its clusters, 40 times 1e-16 of a metre."""
    alone = end_state(world(0, **parts), steps=20, kernel=kernel, threads=threads)
    state = end_state(world(2, **parts), steps=20, kernel=kernel, threads=threads)
    count = len(alone.position)
    assert np.array_equal(state.position[:count], alone.position)
    assert np.array_equal(state.velocity[:count], alone.velocity)
    body_set = world(2, **parts).body_set
    assert np.abs(state.position[count:] - body_set.position[count:]).max() < 40 * 4 * 2.0**-53
    assert not state.velocity[count:].any() and not state.inverse_mass[count:].any()


def test_what_comes_in_falls_as_if_it_had_been_there() -> None:
    """A free fall from where it was brought in; its number is that of the copy; the next one is another."""
    scene = world(2)
    with opened(scene, threads=2) as simulation:
        simulation.advance(5)
        first = simulation.add_body("brick", (5.0, 3.0, 0.0), (1.0, 0.0, 0.0))
        second = simulation.add_body("brick", (8.0, 3.0, 0.0))
        copies = scene.body_set.copies
        assert [copies[n].name for n in (first, second)] == ["brick", "brick"] and first != second
        begin = simulation.state().position[copies[first].particles].mean(axis=0)
        simulation.advance(10)
        state = simulation.state()
    where, h = state.position[copies[first].particles].mean(axis=0), 0.005
    drag = scene.damping.coefficient * 1.0 / scene.body_set.clusters.mass[copies[first].particles].mean()  # type: ignore
    fallen, speed, x = 0.0, 0.0, 0.0
    for _ in range(20):
        speed = speed * (1 - drag * h) - 9.81 * h
        fallen += speed * h
        x += h * (1 - drag * h) ** (_ + 1)
    assert begin - [5.0, 3.0, 0.0] == pytest.approx(copies[first].baked.position.mean(axis=0), abs=1e-12)
    assert where - begin == pytest.approx([x, fallen, 0.0], abs=1e-9)
    assert state.inverse_mass.all()


def test_what_leaves_is_in_nobodys_way() -> None:
    """A brick on a brick falls when the lower one leaves, by a free fall."""
    lower, upper = (
        BRICK | {"spare": 1, "spin": [0.0, 0.0, 0.0]},
        BRICK | {"origin": [0.0, 0.3, 0.0], "spin": [0.0, 0.0, 0.0]},
    )
    scene = bodies_scene(lower=lower, upper=upper, plane={"point": [0.0, -0.2, 0.0], "thickness": 0.07}, **CONTACT)
    copies = {copy.name: copy for copy in reversed(scene.body_set.copies)}
    with opened(scene, precision="float64") as simulation:
        simulation.advance(150)
        rests = simulation.state().position[copies["upper"].particles, 1].mean()
        simulation.remove_body(copies["lower"].number)
        simulation.advance(15)
        state = simulation.state()
    assert state.position[copies["upper"].particles, 1].mean() < rests - 0.05
    assert not state.inverse_mass[copies["lower"].particles].any()


def test_a_state_knows_who_waits(tmp_path: Path) -> None:
    """Written, read and gone on from, to the bits; a reset brings the start back."""
    scene = world(1)
    with opened(scene) as simulation:
        number = simulation.add_body("brick", (0.0, 1.5, 0.0))
        simulation.advance(3)
        half = simulation.state()
        write_state(tmp_path / "half.npz", half)
        simulation.advance(4)
        whole = simulation.state()
        simulation.reset()
        assert not simulation.state().inverse_mass[scene.body_set.copies[number].particles].any()
    with opened(scene, initial=read_state(tmp_path / "half.npz", scene)) as again:
        again.advance(4)
        assert same(again.state(), whole)


def test_what_cannot_be_is_told() -> None:
    scene = world(1)
    with opened(scene) as simulation:
        with pytest.raises(SceneError, match="must be one of bar, brick"):
            simulation.add_body("star")
        with pytest.raises(SceneError, match=r"bar\.spare = 0: all spare copies are in use"):
            simulation.add_body("bar")
        with pytest.raises(SceneError, match="no such body now"):
            simulation.remove_body(2)  # waits already
        with pytest.raises(SceneError, match="no such body now"):
            simulation.remove_body(-1)
        state = simulation.state()
        state.inverse_mass[0] = 0  # one particle of a body
        with pytest.raises(InputError, match="inverse_mass"):
            simulation.load(state)
    with opened(world(0)) as simulation, pytest.raises(SceneError, match="must be at least 1"):
        simulation.remove_body(0)
    with pytest.raises(SceneError, match="spare"):
        world(-1)
