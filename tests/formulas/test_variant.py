"""Formulas in the variant that asks (model/base/variant.py): precision, features, products, other formulas."""

from __future__ import annotations

import ast
import inspect
import os
import re
import threading
import time
import traceback
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from softlab.model.base.variant import (
    FEATURE,
    FEATURES,
    OF_PARTS,
    CountOfPrecision,
    Formulas,
    OfPrecision,
    Open,
    Variant,
    check_returns,
    features_of,
    filled,
    formula,
    inlined_routine,
    inlined_throughout,
    instruction,
    integer_formula,
    is_formula,
    parsed,
    plain,
    plain_formulas,
    real,
    routine,
    row_routine,
    unrolled,
)

ROOT = Path(__file__).resolve().parents[2]
THIRD = 1.0 / 3.0
TERMS = 0.1, 0.2
SMALLEST = OfPrecision(lambda real: np.finfo(real).tiny)
HEAVY = 2
end = Open("end(x) -> a number")


@formula
def third(x):
    """A number times a constant of this module."""
    return THIRD * x


@formula
def halved(x):
    return 0.5 * third(x)


@formula
def by_kind(x):
    if FEATURE.kind == HEAVY:
        return 2.0 * x
    if FEATURE.light and not FEATURE.kind > 2:
        return x
    return unknown(x)  # noqa: F821 - no variant below comes here


@formula
def scaled(x):
    x *= 3.0
    for _ in range(1):
        if FEATURE.never:
            x = unknown(x)  # noqa: F821
    return x * real(2)


@formula
def ended(x):
    return end(x) + TERMS[1]


start = Open("start(x) -> a number")


@formula
def started(x):
    return start(x)


@formula
def ended_and_halved(x):
    return halved(ended(x))


@formula
def doubled(x):
    return 2 * x


@formula
def complement(x):
    return 1 - x


@formula
def negative(x):
    return x / -2


@formula
def misspelt(x):
    return x if FEATURE.dampd else 2.0 * x


def helper(x):
    return x


@formula
def calls_helper(x):
    return helper(x)


@formula
def by_axes(x):
    return (x, x) if FEATURE.axes == 2 else (x, x, x)


@formula
def by_call(x):
    return by_axes(x)


@formula
def scaled_by_unknown(x):
    y = 2.0 * x
    return y * unknown(x)  # noqa: F821


@integer_formula
def counted(n):
    return 2 * n


@pytest.fixture
def features(monkeypatch: pytest.MonkeyPatch) -> None:
    """Declare the features of the formulas above."""
    for name in ("kind", "light", "never"):
        monkeypatch.setitem(FEATURES, name, name)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_literals_and_constants_have_the_precision(kind: Any) -> None:
    variant = Variant(kind)
    for made, x in ((variant(third), 1), (variant(halved), 1), (variant(filled(ended, {"end": third})), 1)):
        assert type(made(kind(x))) is kind
    assert variant(halved)(kind(3)) == kind(0.5) * (kind(THIRD) * kind(3))
    assert np.finfo(np.float64).tiny == SMALLEST and Variant(kind)._within(SMALLEST, third) == np.finfo(kind).tiny


def test_as_plain_python_it_is_the_function_that_stands_there() -> None:
    assert halved(3.0) == Variant(np.float64)(halved)(3.0) == 0.5 * (THIRD * 3.0)
    assert filled(ended, {"end": third})(3.0) == THIRD * 3.0 + 0.2


def test_names_are_filled_in_what_is_called_too() -> None:
    """Unless that fills them itself."""
    variant, closed = Variant(np.float64), filled(ended, {"end": third})
    made = variant(filled(ended_and_halved, {"end": third}))
    assert made(3.0) == halved(closed(3.0)) and made is variant(filled(ended_and_halved, {"end": third}))
    assert filled(closed, {"end": halved})(3.0) == closed(3.0)
    with pytest.raises(TypeError, match=r"compile filled\(ended, \.\.\.\): end\(x\)"):
        variant(ended_and_halved)


@pytest.mark.usefixtures("features")
def test_a_feature_is_a_constant_and_what_it_excludes_is_gone() -> None:
    assert Variant(np.float64, plain, {"kind": HEAVY})(by_kind)(4.0) == 8
    assert Variant(np.float64, plain, {"kind": 1, "light": True})(by_kind)(4.0) == 4
    left = Variant(np.float64, plain, {"kind": HEAVY})(by_kind).__code__
    assert "unknown" not in left.co_names and "light" not in left.co_names
    with pytest.raises(AttributeError, match="kind is known inside a variant only"):
        by_kind(1.0)


@pytest.mark.usefixtures("features")
def test_every_product_is_the_variants() -> None:
    """In place of an assignment too, and in formulas that it calls; not of integers."""
    calls: list[tuple[Any, Any]] = []

    def product(a: Any, b: Any) -> Any:
        calls.append((a, b))
        return a * b

    variant = Variant(np.float32, plain, {"never": False}, product=product)
    assert variant(halved)(np.float32(6)) == 1 and len(calls) == 2
    assert variant(scaled)(np.float32(2)) == 12 and len(calls) == 4
    assert variant(counted)(3) == 6 and len(calls) == 4


def test_an_instruction_takes_the_place_of_a_formula() -> None:
    assert Variant(np.float64, plain, instructions={"third": lambda x: 10 * x})(halved)(2.0) == 10


def test_what_is_no_formula_is_refused() -> None:
    """With the file, the line and what to write."""
    for wrong, line, source, literal in (
        (doubled, 2, "2 * x", "2.0"),
        (complement, 2, "1 - x", "1.0"),
        (negative, 2, "x / -2", "-2.0"),
    ):
        where = f"{__file__}:{wrong.__code__.co_firstlineno + line}: `{source}`"
        with pytest.raises(TypeError, match=f"^{re.escape(where)}: an integer literal .* write {literal}"):
            Variant(np.float32)(wrong)
    with pytest.raises(
        TypeError,
        match=rf"test_variant.py:\d+: the formula calls_helper calls helper, .* @formula.*{helper.__code__.co_firstlineno}",
    ):
        Variant(np.float32)(calls_helper)
    with pytest.raises(TypeError, match=r"test_variant.py:\d+: a formula is a `def` at the top level of a file"):
        formula(lambda x: x)
    with pytest.raises(TypeError, match=r"end\(x\) -> a number is open"):
        ended(1.0)
    with pytest.raises(TypeError, match=r"test_variant.py:\d+: compile filled\(ended, \.\.\.\): end\(x\)"):
        Variant(np.float32)(ended)
    with pytest.raises(TypeError, match="ROOT is no formula: write @formula"):
        _ = plain_formulas(inspect.getmodule(third), np.float32).ROOT  # type: ignore[arg-type]


def test_names_and_returns_are_checked() -> None:
    with pytest.raises(
        NameError, match=r"test_variant.py:\d+: the formula scaled_by_unknown uses unknown, which is not defined"
    ):
        Variant(np.float64)(scaled_by_unknown)
    check_returns(by_axes, 2, {"axes": 2})
    check_returns(halved, 1)
    check_returns(by_call, 7)  # what the call returns is not known
    line = by_axes.__code__.co_firstlineno + 2
    with pytest.raises(TypeError, match=rf"test_variant.py:{line}: by_axes returns 3 values with {{'axes': 3}}, not 2"):
        check_returns(by_axes, 2, {"axes": 3})
    with pytest.raises(TypeError, match="helper is no formula: write @formula above it"):
        check_returns(helper, 1)


def test_an_unknown_feature_is_refused() -> None:
    """Where a formula asks for it, and where a variant is given it."""
    where = f"{__file__}:{misspelt.__code__.co_firstlineno + 2}: FEATURE.dampd is unknown: did you mean damped"
    with pytest.raises(AttributeError, match=f"^{re.escape(where)}"):
        Variant(np.float64)(misspelt)
    with pytest.raises(AttributeError, match=r"FEATURE\.sofd is unknown: did you mean soft"):
        Variant(np.float64, plain, {"sofd": True})


def test_a_feature_that_a_variant_does_not_declare_is_refused() -> None:
    """Where any routine that the kernel calls asks for it: code without the feature would be compiled unnoticed."""
    where = (
        f"{__file__}:{doubled_at.__code__.co_firstlineno + 2}: doubled_at asks for FEATURE.damped, which its variant"
    )
    with pytest.raises(AttributeError, match=f"^{re.escape(where)} does not declare"):
        Variant(np.float64).copied(in_registers)
    for damped, result in ((True, 1.0), (False, 0.1)):
        values = np.array([3.0])
        Variant(np.float64, plain, {"damped": damped}).copied(in_registers)(values)
        assert values[0] == result


def test_a_clock_that_nobody_asked_for_time_does_not_stand_still() -> None:
    """A caller that forgets FEATURE.timed gets an error in place of time 0."""
    from softlab.gpu_backend.core.forces import particle_features
    from softlab.gpu_backend.core.integers import clock

    counter, parts = np.array([7]), frozenset({"gust", "wind"})
    with pytest.raises(AttributeError, match=r"clock asks for FEATURE\.timed, which its variant does not declare"):
        Variant(np.float32, plain, features_of(parts))(clock)
    assert Variant(np.float32, plain, particle_features(parts))(clock)(counter, 1, 4, 2) == (8, 34)
    assert Variant(np.float32, plain, particle_features(frozenset()))(clock)(counter, 1, 4, 2) == (0, 0)


def test_errors_point_at_the_line_of_the_file() -> None:
    with pytest.raises(ZeroDivisionError) as found:
        Variant(float)(quotient)(1.0, 0.0)
    last = traceback.extract_tb(found.value.__traceback__)[-1]
    assert last.filename == __file__ and last.line == "return a / b"


@formula
def quotient(a, b):
    return a / b


def test_a_module_offers_its_formulas_and_those_that_it_imports() -> None:
    from softlab.model.formulas import springs

    offered = plain_formulas(springs, np.float32)
    assert isinstance(offered, Formulas) and offered.inverse_length(np.float32(4)) == 0.5
    assert offered.spring_acceleration_2d is offered.spring_acceleration_2d


def test_every_function_of_the_formulas_is_marked() -> None:
    """A function without a mark would be called as plain Python by a kernel, which numba refuses late and at length."""
    unmarked = []
    for path in sorted((ROOT / "model" / "formulas").rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and not node.decorator_list and node.returns is None:
                unmarked.append(f"{path.name}: {node.name}")
    assert unmarked == []
    assert is_formula(third) and is_formula(filled(ended, {"end": third})) and not is_formula(plain)


def test_one_thread_at_a_time_parses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ranks in threads compile at the same time; CPython's parser does not bear it (SystemError)."""
    inside: list[int] = []
    at_once: list[int] = []

    def parse(text: str) -> ast.Module:
        inside.append(1)
        time.sleep(0.01)
        at_once.append(len(inside))
        inside.pop()
        return ast.Module([], [])

    monkeypatch.setattr(ast, "parse", parse)
    threads = [threading.Thread(target=parsed, args=("",)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert at_once == [1, 1, 1, 1]


@routine
def doubled_at(values, k):
    values[3 * k] = 2.0 * halved(values[k]) if FEATURE.damped else 0.1


@row_routine
def along_a_row(values):
    doubled_at(values, 0)


@inlined_routine
def in_registers(values):
    along_a_row(values)


def test_routines_are_compiled_their_own_way_and_keep_their_products() -> None:
    """Indices are products, too: an exact product on CUDA takes floats."""
    ways: list[str] = []

    def way(name: str) -> Any:
        return lambda function: ways.append(f"{function.__name__} {name}") or function

    variant = Variant(
        np.float32, way("compiled"), {"damped": True}, product=lambda a, b: a * b + 100.0,
        instructions={"doubled_at": plain}, ways={"row": way("row"), "inlined": way("inlined")},
    )  # fmt: skip
    values = np.array([3, 0, 0], np.float32)
    variant.copied(in_registers)(values)
    assert ways == ["third compiled", "halved compiled", "doubled_at compiled", "along_a_row row"]
    assert values[0] == np.float32(2) * (np.float32(0.5) * (np.float32(THIRD) * np.float32(3) + 100) + 100)
    variant(in_registers)
    assert ways[-1] == "in_registers inlined"


def test_parts_of_a_scene_are_features_under_their_names() -> None:
    """Those that a scene lacks are off; what no part switches on is not declared, unless a part has its name."""
    features = features_of(frozenset({"friction", "speed-limit", "per-constraint", "of-no-formula"}))
    assert {name for name, is_on in features.items() if is_on} == {"friction", "speed_limit", "per_constraint"}
    assert features.keys() == OF_PARTS.keys() | {"per_constraint"} and "timed" not in features


FIELDS, HALVES = (("left", "right"), ("low", "high")), 2


@routine
def fields_of(record):
    return pair_of(*tuple(record[FIELDS[FEATURE.number][n]] for n in unrolled(HALVES)))


@routine
def pair_of(first, second):
    return second, first


def test_a_table_of_names_gives_the_fields_of_a_record() -> None:
    """The compiled copy names them, as numba needs it."""
    record = {"left": 1.0, "right": 2.0, "low": 3.0, "high": 4.0}
    for number, expected in enumerate([(2.0, 1.0), (4.0, 3.0)]):
        copied = Variant(np.float64, plain, {"number": number}).copied(fields_of)
        assert copied(record) == expected and "FIELDS" not in copied.__code__.co_names


class Sides(NamedTuple):
    LEFT: int
    RIGHT: int


SIDES = Sides(0, 1)


@routine
def right_of(values):
    return values[SIDES.RIGHT]


def test_a_member_of_a_named_tuple_of_integers_is_the_integer() -> None:
    """The copy contains the number, so that another order of the names is other machine code."""
    copied = Variant(np.float64, plain).copied(right_of)
    assert copied((5.0, 7.0)) == 7.0 and "SIDES" not in copied.__code__.co_names


@formula
def of_the_last_axis(values, k):
    return 2.0 * values[2 * k + FEATURE.axes - 1]


def test_an_index_holds_features_and_integers() -> None:
    variant = Variant(np.float32, plain, {"axes": 3}, product=lambda a, b: a * b + 100.0)
    assert variant(of_the_last_axis)(np.arange(9, dtype=np.float32), 3) == 2 * 8 + 100


@instruction
def stored(values, k):
    values[k] = 7.0


@routine
def stores(values):
    stored(values, 1)


def test_the_plain_equivalent_of_an_instruction_is_called_as_it_is() -> None:
    """Under CUDA's simulator routines call what has no machine code there."""
    values: np.ndarray = np.zeros(2)
    copied = Variant(np.float64).copied(stores)
    copied(values)
    assert values[1] == 7 and copied.__globals__["stored"] is stored


WIDTH = 2


@routine
def row_by_twos(values, doubled):
    pairs = tuple((values[WIDTH * m], values[WIDTH * m + 1]) for m in unrolled(FEATURE.anchors // WIDTH))
    whole = FEATURE.anchors // WIDTH * WIDTH
    for n in unrolled(FEATURE.anchors):
        doubled[n] = 2.0 * values[n]
        doubled[n] += values[0]
    return whole, (
        *tuple(pairs[n // WIDTH][n % WIDTH] for n in unrolled(FEATURE.anchors // WIDTH * WIDTH)),
        *tuple(values[n] for n in unrolled(FEATURE.anchors // WIDTH * WIDTH, FEATURE.anchors)),
    )


@pytest.mark.parametrize("count", (1, 2, 5))
def test_unrolled_loops_index_tuples(count: int) -> None:
    values, doubled = np.arange(1.0, count + 1, dtype=np.float32), np.zeros(count, np.float32)
    whole, row = Variant(np.float32, plain, {"anchors": count})(row_by_twos)(values, doubled)
    assert whole == count // 2 * 2 and row == tuple(values)
    assert list(doubled) == [2 * value + 1 for value in values]


def test_numba_knows_the_types_of_unrolled_loops() -> None:
    """In a tuple of tuples an index has to be a literal."""
    import numba

    compiled = Variant(np.float32, numba.njit, {"anchors": 5})(row_by_twos)
    compiled.compile((numba.float32[::1], numba.float32[::1]))
    (overload,) = compiled.overloads.values()
    assert overload.signature.return_type == numba.types.Tuple([numba.int64, numba.types.UniTuple(numba.float32, 5)])


def test_a_copy_has_no_loop_where_it_is_unrolled() -> None:
    copied = Variant(np.float32, plain, {"anchors": 5}).copied(row_by_twos)
    assert not {"range", "unrolled", "tuple"} & set(copied.__code__.co_names)


BLOCK = CountOfPrecision(lambda real: 64 // np.dtype(real).itemsize)


@routine
def of_blocks(count):
    return count * BLOCK


@pytest.mark.parametrize("precision, block", ((np.float32, 16), (np.float64, 8)))
def test_an_integer_that_depends_on_the_precision(precision: Any, block: int) -> None:
    assert Variant(precision)(of_blocks)(3) == 3 * block
    assert type(Variant(precision)(of_blocks).__globals__["BLOCK"]) is int
    assert of_blocks(3) == 3 * 8


nearly = inlined_throughout(ended_and_halved)


@routine
def stores_nearly(values):
    values[0] = nearly(values[0]) + halved(values[0])


def test_a_formula_is_inlined_with_all_that_it_calls() -> None:
    """And compiled as usual where it is called by its own name."""
    compiled: list[str] = []

    def way(name: str) -> Any:
        return lambda function: compiled.append(f"{function.__name__} {name}") or function

    variant = Variant(np.float64, way("compiled"), ways={"inlined": way("inlined")})
    values, names = np.array([3.0]), {"end": third}
    variant.copied(filled(stores_nearly, names))(values)
    assert values[0] == halved(filled(ended, names)(3.0)) + halved(3.0)
    assert sorted(compiled) == [
        "ended inlined", "ended_and_halved inlined", "halved compiled", "halved inlined", "third compiled",
        "third inlined",
    ]  # fmt: skip


def test_names_are_filled_in_what_fills_other_names() -> None:
    """Whether these are open in the formula itself or in what fills its names."""
    closed = filled(ended, {"end": third})
    assert filled(started, {"start": ended, "end": third})(3.0) == closed(3.0)
    assert filled(filled(started, {"start": ended}), {"end": third})(3.0) == closed(3.0)


@formula
def printing(x):
    print(x)
    return x


@formula
def asking(x):
    return x if os.environ else -x


@pytest.mark.parametrize("function", [printing, asking])
def test_what_machine_code_cannot_is_refused(function):
    with pytest.raises(TypeError, match=f"{function.__name__} uses (print|os), which machine code cannot"):
        Variant(np.float32, plain)(function)
