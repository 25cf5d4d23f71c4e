"""Couples of friction between bodies, in plain Python: to the bits of the CPU, stage by stage and step by step."""

from __future__ import annotations

import pytest
from bodies_scenes import bodies_scene, end_state, method, same

BAR = {"shape": {"name": "box", "resolution": 4, "sides": [0.3, 0.2, 0.2]}, "particle_spacing": 0.1}
KINDS = {"rigid": ["rigid_body"] * 2, "soft": ["soft_body"] * 2, "both": ["rigid_body", "soft_body"]}


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("kinds", list(KINDS))
def test_the_bits_of_the_cpu(kinds: str, precision: str) -> None:
    """Of a bar that hits another beside its middle; without friction the end is another one."""
    one, other = (BAR | {"kind": kind} for kind in KINDS[kinds])
    coming = {"origin": [0.05, 0.2, 0.03], "velocity": [0.5, -2.0, 0.0]}
    scene = bodies_scene(one=one, other=other | coming, contact={}, method=method(2, 2))
    host = end_state(scene, precision=precision, steps=2)
    for kernel in ("launch", "stages"):
        assert same(host, end_state(scene, "gpu", precision=precision, kernel=kernel, steps=2)), kernel
    smooth = scene.replace({"contact.static_friction": 1e-30, "contact.dynamic_friction": 0.0})
    assert not same(host, end_state(smooth, precision=precision, steps=2))
