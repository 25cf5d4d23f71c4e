"""A part that a scene lacks leaves no trace in the GPU's kernels: what they compute, and what they read of the record.

Every constant of a scene lies in one small record (model/core/parameters.py) that kernels read whether anything is live or
not, so that being live costs no instruction of its own; the places of it that a kernel loads show which parts it knows.
What test_no_trace.py does for the CPU.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from kernel_text import kernel_text
from ptx_rows import PASS, tile_row

from softlab.model.core import own_forces
from softlab.model.core.parameters import PARAMETERS

# what each part, and each integrator, reads of the record
PART_READS = {
    "springs": {"stiffness", "stiffness_rest"},
    "gravity": {"gravity"},
    "damping": {"damping"},
    "external": {"external"},
    "poke": {"poke_x", "poke_y"},
}
STEP_READS = {
    "lab": {"dt", "half_dt_squared"},
    "semi-implicit-euler": {"dt"},
    "explicit-euler": {"dt"},
    "taylor": {"dt", "half_dt_squared"},
    "velocity-verlet": {"dt", "half_dt"},
}
DAMPED_KICKS = {"damping", "inverse_damping"}  # of velocity Verlet, whose damper is part of its kicks
REALS = [np.float32, np.float64]
FULL = frozenset({"springs", "gravity", "damping", "external", "poke", "pins"})
# Of a kernel's parameters, seven for each array: where the record's begin, then the integers' and the step counter's.
RECORD_AT = {"pass": 4 * 7, "rk4": 8 * 7, "one-block": 4 * 7, "tiles": 4 * 7, "resident": 6 * 7 + 7 + 1 + 7}
ARRAY, DATA = 7, 4  # parameters of an array, and which of them is its address
MULTIPLIERS = ("3528531795", "3449720151")  # of the random generator

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def expected_reads(integrator: str, parts: frozenset[str]) -> set[str]:
    reads = set(STEP_READS[integrator]).union(*(PART_READS.get(part, set()) for part in parts))
    return reads | DAMPED_KICKS if integrator == "velocity-verlet" and "damping" in parts else reads


def loads(text: str, parameter: int) -> set[int]:
    """The places [bytes] that a kernel loads from the array whose parameters begin with number `parameter`."""
    address = re.search(rf"ld\.param\.u64\s+(%rd\d+), \[\S+_param_{parameter + DATA}\];", text)
    if not address:
        return set()
    generic = re.search(rf"cvta\.to\.global\.u64\s+(%rd\d+), {address[1]};", text)
    assert generic
    found = re.findall(rf"ld\.global\S*?(?:\.v(\d))?\.[a-z](\d+)\s[^\n]*\[{generic[1]}(?:\+(\d+))?\]", text)
    return {
        int(offset or 0) + k * int(bits) // 8 for count, bits, offset in found for k in range(int(count or 1))
    }  # fmt: skip


def reads(text: str, kind: str, real: Any) -> set[str]:
    """The constants of the record that a kernel loads, by name."""
    item = np.dtype(real).itemsize
    return {PARAMETERS[place // item] for place in loads(text, RECORD_AT[kind])}


def passes(real: Any, integrator: str, parts: frozenset[str], anew: bool = False) -> dict[str, str]:
    """`anew`: of formulas as they are now, past the memory of kernels made before."""
    from softlab.gpu_backend.mass_spring.grid.kernels import make_passes

    kernels = (make_passes.__wrapped__ if anew else make_passes)(real, "fast", integrator, parts)
    return {name: kernel_text(kernel, PASS, real, "fast") for name, kernel in kernels.items()}


def instructions(text: str) -> Counter[str]:
    return Counter(re.findall(r"^\t(?:@!?%p\d+ )?([a-z][\w.]+)\s", text, re.MULTILINE))


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("dropped", [set(), {"damping", "poke"}, {"external", "gravity"}])
def test_a_pass_reads_what_its_parts_need(dropped: set[str], real: Any) -> None:
    """The record's places of an absent part are not loaded; without random force and poke neither are the array of
    integers and the step counter; the generator's multipliers come and go with the random force."""
    parts = FULL - dropped
    text = passes(real, "lab", parts)["step"]
    assert reads(text, "pass", real) == expected_reads("lab", parts)
    integers = loads(text, RECORD_AT["pass"] + ARRAY)
    assert integers == ({0} if "external" in parts else set()) | ({8} if "poke" in parts else set())
    assert bool(loads(text, RECORD_AT["pass"] + 2 * ARRAY)) == ("external" in parts)
    for number in MULTIPLIERS:
        assert (number in text) == ("external" in parts)


@pytest.mark.parametrize("integrator", [name for name in STEP_READS if name not in ("lab", "velocity-verlet")])
def test_every_integrator_drops_its_damper(integrator: str) -> None:
    for parts in (frozenset({"springs", "damping"}), frozenset({"springs"})):
        text = passes(np.float32, integrator, parts)["step"]
        assert reads(text, "pass", np.float32) == expected_reads(integrator, parts)


VERLET_PARTS = [
    FULL,
    FULL - {"external", "poke"},
    frozenset({"springs", "gravity"}),
]


@pytest.mark.parametrize("parts", VERLET_PARTS)
@pytest.mark.parametrize("real", REALS)
def test_the_passes_of_verlet_read_what_their_parts_need(real: Any, parts: frozenset[str]) -> None:
    texts = passes(real, "velocity-verlet", parts)
    assert set().union(*(reads(text, "pass", real) for text in texts.values())) == expected_reads(
        "velocity-verlet", parts
    )
    for text in texts.values():
        assert (MULTIPLIERS[0] in text) == ("external" in parts)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("rung,tile", [("one-block", "32x4x2h0"), ("tiles", "32x4x2h4"), ("resident", "32x4x2h4")])
def test_a_tile_reads_what_its_parts_need(rung: str, tile: str, real: Any) -> None:
    """Tiles read the whole record at once into registers: the compiler drops what no part uses."""
    for parts in (frozenset({"springs", "gravity", "damping"}), frozenset({"springs"})):
        row = tile_row(rung, "lab", tile, parts, True)
        text = kernel_text(row.kernels(real, "fast")[""], row.letters[""], real, "fast")
        assert reads(text, rung, real) == expected_reads("lab", parts)
        assert not loads(text, RECORD_AT[rung] + ARRAY) and not loads(text, RECORD_AT[rung] + 2 * ARRAY)


@pytest.mark.parametrize("real", REALS)
def test_the_stages_of_rk4_drop_damping_and_random_force(real: Any) -> None:
    from softlab.gpu_backend.mass_spring.grid.kernels import make_rk4_stages

    for parts in (FULL, FULL - {"damping", "external"}):
        for kernel in make_rk4_stages(real, "fast", parts)[:2]:  # the last two differ in constants alone
            text = kernel_text(kernel, "CCCC" + PASS, real, "fast")
            found = reads(text, "rk4", real)
            assert ("damping" in found, "external" in found) == ("damping" in parts, "external" in parts)
            assert (MULTIPLIERS[0] in text) == ("external" in parts)


def never_known(*_: Any) -> Any:
    """In place of a formula: nothing that a variant would compile."""
    raise AssertionError("the formula of an absent part was called")


@pytest.fixture
def unknowing(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The formulas of damping and random force cannot be compiled."""
    from softlab.gpu_backend.core import formulas
    from softlab.gpu_backend.mass_spring.grid import point

    monkeypatch.setattr(point, "damped", never_known)
    monkeypatch.setattr(own_forces, "add_external", never_known)
    monkeypatch.setattr(own_forces, "philox", never_known)
    formulas._variant.cache_clear()
    yield
    formulas._variant.cache_clear()


@pytest.mark.parametrize("real", REALS)
def test_a_bare_kernel_is_one_that_never_knew(real: Any, request: pytest.FixtureRequest) -> None:
    """Instruction by instruction: without the parts, and where their formulas do not even exist."""
    bare = frozenset({"springs", "gravity", "pins"})
    plain = instructions(passes(real, "lab", bare)["step"])
    with_damping = instructions(passes(real, "lab", bare | {"damping"})["step"])
    arithmetic = r"(add|sub|mul|fma|neg)\.\S*f(32|64)"

    def count(found: Counter[str]) -> int:
        return sum(number for name, number in found.items() if re.fullmatch(arithmetic, name))

    assert count(plain) + 2 <= count(with_damping)  # a product and a sum, or both in one, for each axis
    request.getfixturevalue("unknowing")
    assert instructions(passes(real, "lab", bare, anew=True)["step"]) == plain
    with pytest.raises(TypeError, match="never_known, which is no formula"):  # it is seen where it is wanted
        passes(real, "lab", bare | {"damping"}, anew=True)
