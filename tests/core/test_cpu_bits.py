"""Parts that are compiled in but off change no bit; random forces go by seed and step; words for threads."""

import dataclasses

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.cpu_backend.core.threads import thread_count
from softlab.model.core.simulation import State
from softlab.model.scene.scene import load_scene

PARTS = {"grid.rows": 37, "grid.columns": 29, "external.magnitude": 0.05, "external.seed": 2**40 + 7}


def scene_of(name):
    dt = 0.0003 if name in ("explicit-euler", "taylor") else 0.01
    return load_scene("lab-hammock").replace(PARTS | {"method.integrator": name, "method.dt": dt})


def stepped(scene, batches=(40,), **options) -> State:
    with open_simulation(scene, math="exact", allow_unstable=True, **options) as simulation:
        for steps in batches:
            simulation.advance(steps)
        return simulation.state()


def same(a: State, b: State) -> bool:
    return np.array_equal(a.position, b.position) and np.array_equal(a.velocity, b.velocity)


@pytest.mark.parametrize("name", ["lab", "velocity-verlet", "rk4"])
def test_parts_that_are_compiled_in_but_off_change_no_bit(name):
    """The tests of physics compile damper and gravity in as live parts (fewer variants); that alters nothing."""
    scene = load_scene("lab-hammock").replace({"grid.rows": 9, "grid.columns": 7, "method.integrator": name})
    options = {"precision": "float64", "threads": 1, "kernel": "stages"}
    bare = scene.replace({"gravity.enabled": False, "damping.coefficient": 0.0})
    assert same(stepped(bare, **options), stepped(bare, live=("gravity", "damping"), **options))
    fused = {"precision": "float64", "threads": 1, "kernel": "fused"}
    assert same(stepped(scene, **fused), stepped(scene, live=("gravity", "damping"), **fused))
    assert same(stepped(bare, live=("gravity", "damping"), **fused), stepped(bare, **options))


def test_the_seed_and_the_step_make_the_force():
    """Another seed is another force; and the force of step 40 does not depend on where the run began."""
    scene = scene_of("lab")
    options = {"precision": "float64", "live": ("poke",), "threads": 1, "kernel": "team"}
    assert not same(stepped(scene, **options), stepped(scene.replace({"external.seed": 8}), **options))
    later = dataclasses.replace(stepped(scene, (0,), **options), step=5)
    assert not same(stepped(scene, (1,), initial=later, **options), stepped(scene, (1,), **options))


def test_thread_words():
    from softlab.cpu_backend.core.threads import core_count
    from softlab.model.base.errors import SceneError

    assert [thread_count(word) for word in ("1x", "2x", "4x")] == [core_count() * k for k in (1, 2, 4)]
    for bad in ("3x", "0", "-1", "many", "1.5", "", 0, 10**6):
        with pytest.raises(SceneError, match="threads"):
            thread_count(bad)
