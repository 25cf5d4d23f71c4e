"""A part that a scene lacks leaves no trace: no stage, no array, no instruction, no constant that is read.

The CPU's kernels are compiled here anew and their assembly is read; test_no_trace_ptx.py reads the GPU's. Every constant of
a scene lies in one small record (model/core/parameters.py) that kernels read whether anything is live or not, so that being
live costs no instruction of its own; which places of it a kernel reads shows which parts it knows.
"""

from __future__ import annotations

import platform
import re
from collections import Counter
from collections.abc import Callable
from typing import Any

import llvmlite.binding
import numba
import numpy as np
import pytest
from kernel_text import record_of
from numba import types

import softlab.cpu_backend.mass_spring.grid.solver as cpu_mass_spring
from softlab.app.driver import open_simulation
from softlab.cpu_backend.mass_spring.arrays import Passes, Sheet
from softlab.cpu_backend.mass_spring.grid import row_step
from softlab.cpu_backend.mass_spring.grid.kernels import make_advance
from softlab.model.base.variant import formula
from softlab.model.core import own_forces
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.parameters import PARAMETERS
from softlab.model.mass_spring.plan import mass_spring_plan
from softlab.model.scene.scene import Scene, load_scene

PRECISIONS = ["float32", "float64"]
DROPS: dict[str, dict[str, Any]] = {
    "damping": {"damping.coefficient": 0.0},
    "gravity": {"gravity.enabled": False},
    "external": {"external.magnitude": 0.0},
}
FULL = {"external.magnitude": 0.05, "grid.rows": 6, "grid.columns": 20}
PHILOX = {word for value in (0xD2511F53, 0xCD9E8D57) for word in (str(value), str(value - 2**32), hex(value))}


def holds_generator(text: str) -> bool:
    """Whether a multiplier of the random generator stands in the machine code."""
    return bool(PHILOX & set(re.findall(r"-?\b(?:0x[0-9a-f]+|\d+)\b", text)))


@formula
def never_known(*_):
    """In place of a formula: nothing that numba could compile."""
    raise AssertionError("the formula of an absent part was called")


# ---------------------------------------------------------------------- the plan and the arrays


@pytest.mark.parametrize("integrator", list(INTEGRATORS))
@pytest.mark.parametrize("part", DROPS)
def test_a_dropped_part_takes_its_stages_along(part: str, integrator: str) -> None:
    """What is left is the plan of the full scene without those stages, in the same order."""
    scene = load_scene("lab-grid").replace({**FULL, "method.integrator": integrator})
    words = {"damping": "damping", "gravity": "gravity", "external": "external force"}

    def names(of: Scene) -> list[str]:
        return [stage.name for stage in mass_spring_plan(of).root.stages()]

    with_it, without = names(scene), names(scene.replace(DROPS[part]))
    assert without == [name for name in with_it if name != words[part]]
    has_stage = not (part == "damping" and integrator == "velocity-verlet")  # there it is part of the kicks
    assert (words[part] in with_it) == has_stage


def test_what_is_live_adds_its_own_stage_alone() -> None:
    scene = load_scene("lab-grid").replace({"gravity.enabled": False, "damping.coefficient": 0.0})
    nothing = mass_spring_plan(scene)
    assert mass_spring_plan(scene, frozenset({"dt", "stiffness"})).parts == nothing.parts
    for live, stage in (("gravity", "gravity"), ("poke", "poke"), ("damping", "damping")):
        plan = mass_spring_plan(scene, frozenset({live}))
        assert plan.parts - nothing.parts == {live}
        assert [s.name for s in plan.root.stages() if s.name != stage] == [s.name for s in nothing.root.stages()]


def array_sizes(scene: Scene, kernel: str, precision: str) -> dict[str, int]:
    """Bytes of every array that a simulation on the CPU holds, by its name."""
    with open_simulation(scene, kernel=kernel, precision=precision, threads=1) as simulation:
        return {name: value.nbytes for name, value in vars(simulation).items() if isinstance(value, np.ndarray)}


@pytest.mark.parametrize("precision", PRECISIONS)
def test_no_part_has_an_array_of_its_own(precision: str) -> None:
    """Damping, gravity and random force have none; pins have their indices, and nothing where there are none.

    (Kernel `stages`: it shares its compiled stages, so that nothing new is compiled. What the others hold besides,
    scratch rows a thread, does not depend on the parts either.)
    """
    scene = load_scene("lab-grid").replace(FULL)
    whole = array_sizes(scene, "stages", precision)
    for change in DROPS.values():
        assert array_sizes(scene.replace(change), "stages", precision) == whole
    free = array_sizes(scene.replace({"grid.pinned": "none"}), "stages", precision)
    assert whole["_pin_column"] == 2 * 8 and free["_pin_column"] == 0
    assert {name: size for name, size in free.items() if not name.startswith("_pin_")} == {
        name: size for name, size in whole.items() if not name.startswith("_pin_")
    }


# ---------------------------------------------------------------------- the CPU's machine code

INTS, UINTS = types.int64[::1], types.uint64[::1]
FLOATING = r"v(add|sub|mul|div|sqrt|rsqrt\w*|rcp\w*|fn?m(add|sub)\d+)[ps][sd]"


@pytest.fixture(scope="module")
def fresh() -> Callable[..., Any]:
    """fresh(real, math, integrator, parts, tag=""): the kernel `fused`, compiled anew (code from a cache cannot be read);
    once for all tests of this file."""
    known: dict[tuple, Any] = {}

    def kernel(real: Any, math: str, integrator: str, parts: frozenset[str], tag: str = "") -> Any:
        variant = (real, math, integrator, parts, tag)
        if variant not in known:
            scalar = types.float32 if real is np.float32 else types.float64
            whole = types.int64
            dispatcher = make_advance.__wrapped__(
                real, math, integrator, parts
            )  # past the memory of kernels made before
            dispatcher._cache = numba.core.caching.NullCache()
            members = INTS, record_of(real, "grid").dtype, UINTS, INTS, INTS, types.Tuple(()), types.Tuple(())
            passes, sheet = types.NamedUniTuple(whole, 4, Passes), types.NamedTuple(members, Sheet)
            dispatcher.compile((whole, types.Tuple((passes, scalar[::1], whole, sheet, scalar[:, ::1]))))
            known[variant] = dispatcher
        return known[variant]

    return kernel


def whole(dispatcher: Any) -> str:
    (compiled,) = dispatcher.overloads.values()
    return str(compiled.library.get_asm_str())


def assembly(dispatcher: Any) -> str:
    """What a band of rows is walked with: all that a step computes, without what numba puts around it and what it calls."""
    text = whole(dispatcher)
    name = re.search(r"^\t\.type\t(\S*advance_band\S*),@function$", text, re.MULTILINE)
    assert name
    return text[name.end() : text.index(f"\t.size\t{name[1]},")]


def vector_instructions(dispatcher: Any) -> Counter[str]:
    """How often each instruction on vector registers stands there: every number of a state goes through them. (Those on
    whole numbers, places in memory, differ a little from one compilation of the same kernel to the next.)"""
    return Counter(re.findall(r"^\t(v[a-z]\w+)\t", assembly(dispatcher), re.MULTILINE))


def floating(counts: Counter[str]) -> int:
    """Of them those that compute."""
    return sum(count for name, count in counts.items() if re.fullmatch(FLOATING, name))


@pytest.fixture
def x86() -> None:
    if platform.machine().lower() not in ("x86_64", "amd64"):
        pytest.skip(f"reads x86-64 assembly, this is {platform.machine()}")
    if numba.config.CPU_NAME is None and not llvmlite.binding.get_host_cpu_features().get("avx2"):
        pytest.skip("needs a processor with AVX2")


PLAIN = frozenset({"springs", "pins"})
CPU_VARIANTS = [("float32", "lab"), ("float64", "lab")]


@pytest.mark.parametrize("precision,integrator", CPU_VARIANTS)
def test_the_cpu_has_no_instruction_of_an_absent_part(
    x86: None, fresh: Callable[..., Any], precision: str, integrator: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kernel of a scene without damping and random force is, instruction by instruction, that of formulas which
    never knew of them; each part adds arithmetic, and the random force its generator."""
    real = np.dtype(precision).type
    plain = fresh(real, "fast", integrator, PLAIN)
    damped = fresh(real, "fast", integrator, PLAIN | {"damping"})
    assert floating(vector_instructions(plain)) < floating(vector_instructions(damped))
    assert not holds_generator(whole(plain)) and not holds_generator(whole(damped))
    if precision == "float32":  # the check sees what it looks for
        assert holds_generator(whole(fresh(real, "fast", integrator, PLAIN | {"external"})))

    monkeypatch.setattr(row_step, "damped", never_known)
    monkeypatch.setattr(own_forces, "add_external", never_known)
    monkeypatch.setattr(own_forces, "philox", never_known)
    unknowing = fresh(real, "fast", integrator, PLAIN, tag="unknowing")
    assert vector_instructions(unknowing) == vector_instructions(plain)
    with pytest.raises(numba.core.errors.TypingError):  # it is seen where it is wanted
        fresh(real, "fast", integrator, PLAIN | {"damping"}, tag="unknowing")


LAB = {"springs", "stiffness", "stiffness_rest", "dt", "half_dt_squared"}
VERLET = {"springs", "stiffness", "stiffness_rest", "dt", "half_dt"}
READS = [
    ("lab", frozenset(), LAB),
    ("lab", frozenset({"damping"}), LAB | {"damping"}),
    ("velocity-verlet", frozenset(), VERLET),
]  # fmt: skip


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("integrator,parts,wanted", READS)
def test_the_cpu_reads_no_constant_of_an_absent_part(
    fresh: Callable[..., Any], integrator: str, parts: frozenset[str], wanted: set[str], precision: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Every other place of the record holds NaN: the state comes out as before, to the bit. One that is read spoils it."""
    monkeypatch.setattr(cpu_mass_spring, "make_advance", fresh)
    damping = 0.03 if "damping" in parts else 0.0
    scene = load_scene("lab-grid").replace(
        {"grid.rows": 6, "grid.columns": 20, "gravity.enabled": False, "damping.coefficient": damping,
         "perturbation.amplitude": 0.1, "method.integrator": integrator}
    )  # fmt: skip

    def end(unread: set[str]) -> bytes:
        with open_simulation(scene, kernel="fused", precision=precision, threads=1) as simulation:
            assert simulation.plan.parts == PLAIN | parts
            for name in unread:
                simulation.record[name] = np.nan
            simulation.advance(3)
            return simulation.read("position").tobytes() + simulation.read("velocity").tobytes()

    assert end(set(PARAMETERS) - wanted) == end(set())
    assert end({"stiffness"}) != end(set())
    if parts:
        assert end(set(parts)) != end(set())
