"""The kernels of contacts between particles compile for a GPU without one: no double in float32, no local memory, no
atomics but on whole numbers."""

from __future__ import annotations

import re
from itertools import product

import numpy as np
import pytest
from kernel_text import kernel_text

# of each kernel's arguments, see kernel_text.py
FIND = {
    "hash_particles": "RRII",
    "fill_buckets": "IIII",
    "arrange": "RIIIIRII",
    "find_neighbours": "RRIIRIIIIiRIIL",
}
PROJECT = {"count": "RIIRIIiR", "project": "RRIIRIIiR"}
ENDS = {"finish": "RRRRPRULlll", "update_velocity": "RRRRP"}
PARTS = frozenset({"gravity", "poke", "damping", "load", "plane", "friction"})
ATOMICS = {"hash_particles", "fill_buckets", "find_neighbours"}

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def stays_in_registers(text: str) -> bool:
    return ".f64" not in text and ".local" not in text and "call" not in text


@pytest.mark.parametrize("own,many", list(product([True, False], repeat=2)))
@pytest.mark.parametrize("name", FIND)
def test_finding(name: str, own: bool, many: bool) -> None:
    from softlab.gpu_backend.contact.particles_find import make_find

    text = kernel_text(getattr(make_find(np.float32, own, many), name), FIND[name], np.float32, "exact")
    assert stays_in_registers(text)
    assert "fma" not in text
    atomics = re.findall(r"\b(?:atom|red)\.\S+", text)
    assert bool(atomics) == (name in ATOMICS)
    assert all(word.endswith((".u32", ".s32", ".u64")) for word in atomics)


@pytest.mark.parametrize("own,many", [(True, True), (False, False)])
@pytest.mark.parametrize("has_friction,has_adhesion", list(product([True, False], repeat=2)))
@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", PROJECT)
def test_projecting(name: str, math: str, has_friction: bool, has_adhesion: bool, own: bool, many: bool) -> None:
    from softlab.gpu_backend.contact.particles_project import make_project

    kernel = getattr(make_project(np.float32, math, has_friction, has_adhesion, own, many), name)
    text = kernel_text(kernel, PROJECT[name], np.float32, math)
    assert stays_in_registers(text)
    assert not re.search(r"\b(?:atom|red)\.", text)


@pytest.mark.parametrize("math", ["fast", "exact"])
def test_projecting_rigid_bodies(math: str) -> None:
    """With their travels: one more quad is written."""
    from softlab.gpu_backend.contact.particles_project import make_project

    kernel = make_project(np.float32, math, True, True, True, True, True).project
    text = kernel_text(kernel, f"{PROJECT['project']}RR", np.float32, math)
    assert stays_in_registers(text) and text.count("st.global.v4.f32") == 2


@pytest.mark.parametrize("has_rigid,quads", [(False, 2), (True, 3)])
@pytest.mark.parametrize("math", ["fast", "exact"])
def test_projecting_with_couples(math: str, has_rigid: bool, quads: int) -> None:
    """They are one more quad, beside that of travels."""
    from softlab.gpu_backend.contact.particles_project import make_project

    kernel = make_project(np.float32, math, True, True, True, True, has_rigid, True).project
    text = kernel_text(kernel, f"{PROJECT['project']}{'R' * (2 * quads - 3)}", np.float32, math)
    assert stays_in_registers(text) and text.count("st.global.v4.f32") == quads


@pytest.mark.parametrize("parts", [{"speed-limit", "sleeping"}, {"speed-limit"}, {"sleeping", "pins"}, set()])
@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", ENDS)
def test_ends(name: str, math: str, parts: set[str]) -> None:
    from softlab.gpu_backend.contact.particles_project import make_contact_ends

    kernel = getattr(make_contact_ends(np.float32, math, PARTS | parts), name)
    text = kernel_text(kernel, ENDS[name], np.float32, math)
    assert stays_in_registers(text)
    assert text.count("st.global.v4.f32") == 2


@pytest.mark.parametrize("name", ["count", "project"])
def test_exact_kernels_contract_nothing(name: str) -> None:
    """In float64, whose quotients and roots are instructions: no product runs into a sum."""
    from softlab.gpu_backend.contact.particles_project import make_project

    kernel = getattr(make_project(np.float64, "exact", True, True, True, True), name)
    text = kernel_text(kernel, PROJECT[name], np.float64, "exact")
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text
