"""The kernels of what bounces compile for a GPU without one: pairs of particles, and rigid bodies off colliders. No double in
float32, no local memory, no atomics, and in exact math nothing contracted."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from kernel_text import kernel_text

# of each kernel's arguments, see kernel_text.py
PAIRS = {"count": "RRRIIRIIiR", "bounce": "RRRIIRIIiR"}
BODIES = {"weigh": "RRIIRRRR", "go": "RRRIIRR", "differ": "RR"}
PRESSED = {"count rigid": "RRRIIRIIiRRR", "weigh met": "RRIIRRRR", "clear": "IR"}
GIVEN = {"give": "RRRIIRIIiRRRRR", "spread": "IIRRR", "join": "RRRIIRR"}
RIGID = {
    "begin": "RRRPUR", "predict": "RRRRPR", "move": "RIIRRR", "rate": "RRRIIRRPR", "update": "RRRPR",
    "update_calmed": "RRRRPR", "rest": "RRRIII", "steady": "RRIIRR",
}  # fmt: skip
ENDS = {"collide": "RRRPRULlll", "strike": "RRRRPRULlll"}
PARTS = frozenset({"gravity", "poke", "damping", "load", "plane", "friction", "restitution", "sleeping", "speed-limit"})

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def text_of(name: str, real: Any, math: str) -> str:
    from softlab.gpu_backend.contact.particles_bounce import make_bounce
    from softlab.gpu_backend.contact.particles_project import make_contact_ends, make_project
    from softlab.gpu_backend.shape_matching.bodies_bounce import make_bodies_bounce, make_give
    from softlab.gpu_backend.shape_matching.rebound import make_collide_rebound, make_rebound
    from softlab.gpu_backend.shape_matching.rigid import make_begin, make_ends

    if name in RIGID:
        rigid = make_begin(real, math, PARTS) if name in ("begin", "predict") else make_ends(real, math, PARTS)
        return kernel_text(getattr(rigid, name), RIGID[name], real, math)
    if name in PAIRS:
        return kernel_text(getattr(make_bounce(real, math, True, True), name), PAIRS[name], real, math)
    if name in PRESSED:
        made = {
            "count rigid": lambda: make_bounce(real, math, True, True, True).count,
            "weigh met": lambda: make_rebound(real, math, True).weigh,
            "clear": lambda: make_project(real, math, True, True, True, True, True).clear,
        }[name]()
        return kernel_text(made, PRESSED[name], real, math)
    if name in BODIES:
        return kernel_text(getattr(make_rebound(real, math), name), BODIES[name], real, math)
    if name in GIVEN:
        made = (
            make_give(real, math, True, True, True) if name == "give" else getattr(make_bodies_bounce(real, math), name)
        )
        return kernel_text(made, GIVEN[name], real, math)
    made = make_collide_rebound(real, math, PARTS) if name == "strike" else make_contact_ends(real, math, PARTS).collide
    return kernel_text(made, ENDS[name], real, math)


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", [*PAIRS, *PRESSED, *BODIES, *GIVEN, *RIGID, *ENDS])
def test_float32_stays_in_registers(name: str, math: str) -> None:
    text = text_of(name, np.float32, math)
    assert ".f64" not in text and ".local" not in text and "call" not in text
    assert not re.search(r"\b(?:atom|red)\.", text)


@pytest.mark.parametrize("name", [*PAIRS, "count rigid", "weigh", "go", "give", "join"])
def test_exact_math_contracts_nothing(name: str) -> None:
    text = text_of(name, np.float64, "exact")
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text
