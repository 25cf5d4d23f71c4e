"""Module-level functions, compiled in the variant that asks for them: in a precision, a math, with some features.

A formula stands in its module as an ordinary function, where it is found, read and called as plain Python:

    @formula
    def kicked(velocity, acceleration, dt):
        if FEATURE.damped:
            ...
        return velocity + 0.5 * dt * acceleration

`Variant(np.float32, numba.njit, {"damped": True})` compiles a copy of it in which
- literals and constants of its module that are floats have the variant's precision, so that float32 stays float32;
- `FEATURE.damped` is True or False (or a number, to be compared), and a branch that is never chosen is gone before the
  compiler sees it. A feature is an entry of FEATURES; other names are refused, and so are features that a formula asks
  for and its variant does not declare: a caller that forgets them would compile other code without notice;
- formulas that it calls are compiled in the same variant, or replaced by the instructions that the variant names;
- `a * b` is a call of the variant's product, if it has one (for CUDA, which otherwise contracts a * b + c).

Line numbers are those of the file, so that tracebacks and debuggers show it. An integer literal times a float32 is a
float64 in numba: formulas with one are refused (`2.0 * x`, not `2 * x`), as are `float(x)` and `np.float64(x)`. Integer
arithmetic is an `integer_formula`, whose products stay as they are.

`for n in unrolled(3)` and `tuple(f(n) for n in unrolled(3))` are written out, so that n may be an index of a tuple;
`NAMES[n]` of a module's tuple of strings is the string, so that it may name a field of a record. `PASS.MOVE` of a module's
named tuple of integers is the integer.

A kernel, or a function that it calls and that reads or writes arrays, is a `routine`: it stands in its module and is
compiled in the same variants, with its products as they are. `copied` is the copy of a kernel, which a backend compiles
its own way.
"""

from __future__ import annotations

import ast
import builtins
import copy
import inspect
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from functools import cache, cached_property
from threading import Lock
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any, Protocol, TypeGuard, TypeVar

import numpy as np

from softlab.model.base.types import Compile, Feature, Features, FeatureSet, Index, Number, Real

F = TypeVar("F", bound=Callable)
Node = TypeVar("Node", bound=ast.AST)
PRODUCT = "_product"  # name of the variant's product in compiled copies
_PARSING = Lock()
COMPARED: dict[type[ast.cmpop], Callable[..., bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Gt: operator.gt,
    ast.Lt: operator.lt,
}
COMPILED_BUILTINS = (abs, all, any, divmod, len, max, min, pow, round, sum)
COMPILED_MODULES = ("math", "numba", "numpy", "operator")
SINGLE = "single"  # the feature of every float32 variant
OF_PARTS = {  # features that a part of a scene switches on: `features_of` declares all of them
    "alternating": "every second structural constraint has its own constants",
    "attachments": "there are long-range attachments",
    "averaged": "corrections of a fluid are averaged over neighbours",
    "averaged_jacobi": "all constraints act at one position, and the mean of their displacements moves a mass",
    "bending": "there are bending constraints",
    "body_damping": "bodies have damping rates of their own",
    "box": "there are boxes among the colliders",
    "capsule": "there are capsules among the colliders",
    "chebyshev": "sweeps are accelerated",
    "cluster_damping": "clusters damp the motion of their particles",
    "cohesion": "a fluid has cohesion",
    "colliders_in_iterations": "colliders act before each iteration, too",
    "contact_adhesion": "particles attract each other in contacts",
    "contact_friction": "contacts of particles have friction",
    "contact_restitution": "contacts of particles have restitution",
    "contacts": "particles may be in contact",
    "couples": "friction turns clusters",
    "damping": "air damps the motion of particles",
    "distance_field": "there are distance fields among the colliders",
    "drag": "a fluid has drag",
    "emitter": "a fluid has emitters",
    "fluids": "there are several fluids",
    "friction": "contacts have friction",
    "friction_in_place": "friction of colliders acts on positions, too",
    "gravity": "there is gravity",
    "gust": "the wind has gusts",
    "implicit": "springs act at the end of a step",
    "jacobi": "all constraints act at one position, and the sum of their displacements moves a mass",
    "lattices": "bodies have lattices of windows",
    "linear": "one linearised step of implicit Euler; clusters with linear deformation",
    "links": "links join particles of bodies",
    "load": "masses differ",
    "mesh_collider": "there are meshes among the colliders",
    "motion": "pins follow a motion",
    "moving": "walls of a fluid move",
    "pins": "some particles are pinned",
    "plane": "there are planes among the colliders",
    "plastic": "clusters keep strains",
    "repeats": "the domain is periodic",
    "restitution": "contacts have restitution",
    "rigid_bounce": "rigid bodies rebound from one another",
    "rigid_motion": "there are rigid bodies",
    "rigid_rebound": "rigid bodies rebound from colliders",
    "self_contact": "some body touches itself",
    "shear": "there are shear constraints",
    "sink": "a fluid has sinks",
    "sleeping": "slow particles rest",
    "solids": "there are samples of solids among a fluid's particles",
    "spare": "copies of bodies wait to be added",
    "speed_limit": "particles have a maximum speed",
    "sphere": "there are spheres among the colliders",
    "springs": "attachments are springs",
    "structural": "there are structural constraints",
    "surface_tension": "a fluid has surface tension",
    "swept": "capsules and boxes are swept: no path in a step crosses them",
    "tensile": "a fluid has the tensile correction",
    "two_stages": "a substep has two solves",
    "viscosity": "a fluid has viscosity",
    "vorticity": "a fluid has vorticity confinement",
    "walls": "there are walls of a fluid",
    "wind": "there is wind",
}
FEATURES = (
    OF_PARTS
    | {  # what a variant may have and a formula may ask for: the others are declared where a kernel is compiled
        "alone": "a tetrahedron conserves its own volume, not with others of its voxel",
        "anchors": "number of anchors of a long-range attachment",
        "area": "numbers of a plane in shared memory",
        "around": "the constraints of a run share corners with its last one",
        "at_across": "number of the scratch rows of the pulls along the row",
        "at_close": "number of the scratch rows of the sums of accelerations",
        "at_down": "number of the scratch rows of the pulls down to the next row",
        "at_far_across": "number of the scratch rows of the bending pulls along the row",
        "at_far_down": "number of the scratch rows of the bending pulls down",
        "at_first": "number of the scratch rows of the wind on the lower triangles",
        "at_left": "number of the scratch rows of the pulls down to the left",
        "at_once": "particles end a substep with the last displacement to their goals",
        "at_open": "number of the scratch rows of the sums of accelerations of the step before",
        "at_right": "number of the scratch rows of the pulls down to the right",
        "at_second": "number of the scratch rows of the wind on the upper triangles",
        "axes": "2 or 3 dimensions",
        "balls": "vertices are balls, each of a radius",
        "blocks": "constraints of a tetrahedron are solved together",
        "calmed": "particles have a speed limit or sleep",
        "changing": "forces on single particles depend on the step number",
        "classes": "number of classes of a combed row",
        "cleared": "groups of scratch rows that a walk clears",
        "closed": "contacts are with surfaces that have an inside",
        "colliders": "there are colliders",
        "colour": "number of a colour of constraints",
        "columns_along": "columns between the ends of a constraint",
        "constants": "number of a kind of constraints in OF_SHEETS",
        "constraints": "there are constraints",
        "corners": "number of corners of an attachment",
        "cut": "the grid's last row may be inside a thread's strip",
        "damped": "there is a damper",
        "family": "number of a family of constraints",
        "fast": "fast math, sums in any order",
        "fetched": "masses that a thread fetches",
        "fields": "numbers of a mass in shared memory",
        "first_before": "first number of the positions before the substep in shared memory",
        "first_column": "column of the first tile's first mass",
        "first_multiplier": "number of the first multiplier of a mass or of a colour",
        "first_row": "row of the first tile's first mass",
        "first_triple": "number of a family's first triple of scratch rows",
        "flow": "a fluid has emitters or sinks",
        "followed": "more constraint sets follow",
        "forced": "there are forces on single particles",
        "halo": "rings of masses around those that a tile owns",
        "halo_columns": "columns of a tile before those that its block writes",
        "halo_rows": "rows of a tile before those that its block writes",
        "idle_triple": "number of the triple of scratch rows that is not read",
        "kinds": "there is more than one kind of bodies",
        "lattice_columns": "columns of threads that cover a colour of a tile",
        "lattice_rows": "rows of threads that cover a colour of a tile",
        "lattice_shift": "rows or columns from a tile's first mass to the first constraint of a colour",
        "levers": "friction of surfaces acts at the vertex, and turns triangles",
        "limited_change": "a fluid has a maximum acceleration",
        "limits": "a smoothing also limits velocities",
        "mass_forces": "accelerations differ between masses",
        "masses_each": "masses of a thread",
        "material": "number of the elastic energy",
        "moved": "how many corners a constraint moves",
        "multiplier_plane": "number of a family's plane of multipliers",
        "multipliers": "how many multipliers a constraint has",
        "name_of_compliance": "the constraints' compliance in the record of constants",
        "name_of_damping": "the constraints' damping in the record of constants",
        "name_of_stiffening": "the constraints' stiffening in the record of constants",
        "neighbour_velocities": "neighbours' velocities act on a mass",
        "neighbours": "capacity of a neighbour list",
        "number": "number of the constraint set in its tuple",
        "numbers": "how many numbers a row has",
        "owned_columns": "columns of a tile that its block writes",
        "owned_rows": "rows of a tile that its block writes",
        "pairs": "rebounds are limited by both bodies of a pair",
        "particle_forces": "there are forces on single particles",
        "per_constraint": "each constraint has its own compliance",
        "periodic_x": "the domain is periodic along x",
        "periodic_y": "the domain is periodic along y",
        "periodic_z": "the domain is periodic along z",
        "pitch": "numbers of a row of a plane in shared memory",
        "planes": "particles are stored in planes, not in rows",
        "rates_apart": "velocities are computed before colliders act",
        "region": "masses from the middle of a window to its edge",
        "registers": "multipliers of a thread",
        "rests": "rigid bodies come to rest",
        "rising": "constraints lead to the left",
        "rows_down": "rows between the ends of a constraint",
        "run": "how many constraints a thread projects one after the other",
        "scaled": "impulses are scaled by the response of both bodies",
        "scaled_impulses": "impulses of a pair are scaled by the smaller factor of both",
        "separate_before": "positions at the start of a substep have planes of their own",
        "shapes": "neighbours need normals and vorticities",
        SINGLE: "float32",
        "slot": "number of a thread's mass",
        "slots": "constraints of a thread of one colour",
        "smoothing": "neighbours change a fluid's velocities",
        "soft": "constraints have a compliance",
        "stage": "number of the stage of RK4, from 0",
        "stencil": "rings of masses that the forces on a mass depend on",
        "stencil_rows": "largest number of rows between the ends of a constraint",
        "strip": "masses of a thread",
        "threads": "number of threads of a block",
        "tile_columns": "columns of a tile",
        "tile_pitch": "quads from a row of a tile to the next",
        "tile_quads": "quads of a tile",
        "tile_rows": "rows of a tile",
        "tile_threads": "threads of a tile's block",
        "timed": "something depends on the number of the step",
        "triples": "number of triples of scratch rows",
        "uneven": "a row has masses of other weights than 1",
        "upwards": "a scan is along z, not y",
        "values": "how many numbers a constraint has",
        "verlet": "the integrator is velocity Verlet",
        "whole": "the grid is one tile",
    }
)


class _Features:
    """`FEATURE.name` in a formula is a constant of the variant."""

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"FEATURE.{name} is known inside a variant only: Variant(real, plain, features)")


FEATURE = _Features()


class OfPrecision(float):
    """A constant that depends on the precision: `make(real)`. As plain Python it is the one of float64."""

    make: Callable[[Real], Number]

    def __new__(cls, make: Callable[[Real], Number]) -> OfPrecision:
        constant = super().__new__(cls, make(np.float64))
        constant.make = make
        return constant


class CountOfPrecision(int):
    """The same of an integer: a literal where it is used, which the result of a function is not."""

    make: Callable[[Real], int]

    def __new__(cls, make: Callable[[Real], int]) -> CountOfPrecision:
        count = super().__new__(cls, make(np.float64))
        count.make = make
        return count


def real(number: Number | Index) -> np.floating:
    """Return a number in the variant's precision; as plain Python, in float64."""
    return np.float64(number)


def unrolled(*bounds: int) -> range:
    """Return range(*bounds), of a loop that copies write out; the bounds are integers, features and constants."""
    return range(*bounds)


def formula(function: F) -> F:
    """Mark a function of floating-point arithmetic as one that variants compile. Raises TypeError: it is not at the top
    level of a file."""
    return _marked(function, rounds_products=True)


def integer_formula(function: F) -> F:
    """Mark a function of integers as one that variants compile. Raises TypeError: it is not at the top level of a
    file."""
    return _marked(function, rounds_products=False)


def routine(function: Callable) -> Callable:
    """Mark a kernel, or a part of one that reads or writes arrays, as one that variants compile. Raises TypeError: it is
    not at the top level of a file."""
    return _marked(function, rounds_products=False)


def row_routine(function: Callable) -> Callable:
    """Mark a routine as a loop along rows: its arrays do not overlap, except for those that it only reads."""
    return _marked(function, rounds_products=False, how="row")


def inlined_routine(function: Callable) -> Callable:
    """Mark a routine whose arguments cost more to pass than its body, or are arrays in registers."""
    return _marked(function, rounds_products=False, how="inlined")


def instruction(function: F) -> F:
    """Mark the plain equivalent of an instruction, for where nothing is compiled: routines call it as it is."""
    function.__dict__["is_instruction"] = True
    return function


def _marked(function: F, rounds_products: bool, how: str = "") -> F:
    if function.__name__ != function.__qualname__ or function.__name__ == "<lambda>":
        raise TypeError(
            f"{place(function)}: a formula is a `def` at the top level of a file, not {function.__qualname__}"
        )
    function.__dict__.update(rounds_products=rounds_products, how=how)
    return function


def place(function: Callable) -> str:
    """Return `file:line` of a function."""
    return f"{inspect.getfile(function)}:{function.__code__.co_firstlineno}"


class Open:
    """An open name: `filled` replaces it, usually by a formula with this `signature`."""

    def __init__(self, signature: str):
        self.signature = signature

    def __call__(self, *arguments: object) -> Any:
        raise TypeError(f"call a formula made by filled(...): {self.signature} is open")


def open_constant(description: str) -> Any:
    """Return an open name of a number, or of a tuple of them."""
    return Open(description)


class Marked(Protocol):
    """A formula or a routine, or one whose open names are replaced; `how` it is compiled: "row", "inlined" or ""."""

    rounds_products: bool
    how: str
    __name__: str
    __module__: str
    __code__: CodeType
    __globals__: dict[str, object]

    def __hash__(self) -> int: ...

    def __call__(self, *arguments: object) -> Any: ...


class Filled:
    """A formula whose open names are replaced by formulas."""

    def __init__(self, function: Marked, names: Mapping[str, object]):
        self.function, self.names, self._key = function, names, (function, frozenset(names.items()))
        self.__name__, self.__module__, self.__doc__ = function.__name__, function.__module__, function.__doc__
        self.rounds_products, self.how = function.rounds_products, function.how

    def __call__(self, *arguments: object) -> Any:
        return Variant(np.float64)(self)(*arguments)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Filled) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


class Inlined(Filled):
    """A formula that is inlined together with everything that it calls."""


def filled(function: Callable, names: Mapping[str, object]) -> Callable:
    """Return a formula in which the open `names` are replaced, also in the functions that it calls."""
    if isinstance(function, Filled):
        return type(function)(function.function, {**names, **function.names})
    return Filled(_formula(function), names)


def inlined_throughout(function: Callable) -> Callable:
    """Return a formula that is inlined with all that it calls: vectorised code must not contain calls."""
    return (
        Inlined(function.function, function.names) if isinstance(function, Filled) else Inlined(_formula(function), {})
    )


@cache
def open_names(function: Marked) -> frozenset[str]:
    """Return the open names of a formula and of everything that it calls."""
    names: set[str] = set()
    seen: set[object] = {function}
    left = [function]
    while left:
        one = left.pop()
        inner, known = _parts(one)
        called = {name: inner.__globals__.get(name) for name in set(inner.__code__.co_names) - known.keys()}
        names |= {name for name, value in called.items() if isinstance(value, Open)}
        for value in (*known.values(), *called.values()):
            if is_formula(value) and value not in seen:
                seen.add(value)
                left.append(value)
    return frozenset(names)


def _filled_inside(value: object, names: Mapping[str, object]) -> object:
    """Return `value`, which a formula with `names` calls, with those of the names filled that are open in it or in
    these."""
    if not is_formula(value):
        return value
    inside: dict[str, object] = {}
    left: list[object] = [value]
    while left:
        one = left.pop()
        for name in names.keys() & open_names(one) - inside.keys() if is_formula(one) else ():
            inside[name] = names[name]
            left.append(names[name])
    return filled(value, inside) if inside else value


def plain(function: F) -> F:
    """Return `function` uncompiled: the decorator for tests and for reading formulas as ordinary Python."""
    return function


def is_formula(value: object) -> TypeGuard[Marked]:
    return hasattr(value, "rounds_products")


def _formula(function: object) -> Marked:
    """Return a formula. Raises TypeError for anything else."""
    if is_formula(function):
        return function
    raise TypeError(f"{function} is no formula: write @formula above it")


def _parts(formula: Marked) -> tuple[Marked, Mapping[str, object]]:
    """Return the function of a formula, and what replaces its open names."""
    return (formula.function, formula.names) if isinstance(formula, Filled) else (formula, {})


class Variant:
    """One arithmetic and one set of features; `compiled` is the decorator that compiles a function.

    `features`: by name, those that are off too; `product`: what multiplies, or None; `instructions`: names of formulas ->
    functions that take their place; `ways`: decorators of routines that are marked as a row or inlined.
    """

    def __init__(
        self, real: Real, compiled: Compile = plain, features: Features | None = None,
        product: Callable | None = None, instructions: Mapping[str, Callable] | None = None,
        ways: Mapping[str, Compile] | None = None,
    ):  # fmt: skip
        self.real, self.compiled, self.product = real, compiled, product
        for name in features or {}:
            if name not in FEATURES:
                raise AttributeError(_unknown_feature(name))
        self.features = frozenset({**(features or {}), SINGLE: real is np.float32}.items())
        self.instructions, self._ways = instructions or {}, ways or {}
        self._compiled: dict[Marked, Callable] = {}

    def __call__(self, function: object) -> Callable:
        """Return a formula, compiled."""
        if isinstance(function, Inlined):
            return self._inlining(Filled(function.function, function.names))
        formula = _formula(function)
        if formula.rounds_products and formula.__name__ in self.instructions:
            return self.instructions[formula.__name__]
        if formula not in self._compiled:
            self._compiled[formula] = self._ways.get(formula.how, self.compiled)(self.copied(formula))
        return self._compiled[formula]

    @cached_property
    def _inlining(self) -> Variant:
        compiled = self._ways.get("inlined", self.compiled)
        return Variant(self.real, compiled, dict(self.features), self.product, self.instructions, self._ways)

    def of(self, module: ModuleType) -> Formulas:
        """Return the formulas of a module, compiled on first use."""
        return Formulas(self, module)

    def copied(self, formula: object) -> FunctionType:
        """Return a new copy of a formula or routine in this variant, not compiled; what it calls is."""
        function, names = _parts(_formula(formula))
        known = {**vars(builtins), **function.__globals__, **names}
        rounded = self.product is not None and function.rounds_products
        features = _asked(function, self.features)
        code, used, constants = _specialised(function, features, rounded)
        if undefined := sorted(used - known.keys() - constants.keys() - {PRODUCT}):
            raise NameError(
                f"{place(function)}: the formula {function.__name__} uses {undefined[0]}, which is not defined"
            )
        space = {name: self._within(_filled_inside(known[name], names), function) for name in used & known.keys()}
        space |= {name: self.real(value) for name, value in constants.items()}
        space |= {"__name__": function.__module__, "__builtins__": builtins, PRODUCT: self.product}
        exec(code, space)
        copied = space[function.__name__]
        assert isinstance(copied, FunctionType)
        copied.__dict__["softlab_formula"] = function, features, rounded  # of specialised_tree
        return copied

    def _within(self, value: object, caller: Marked) -> object:
        """Return the value of a global of the formula `caller` in this variant."""
        if is_formula(value):
            return self(value)
        if value is real:
            return self.real
        if isinstance(value, float):
            return self.real(value.make(self.real) if isinstance(value, OfPrecision) else value)
        if isinstance(value, CountOfPrecision):
            return value.make(self.real)
        if isinstance(value, Open):
            raise TypeError(f"{place(caller)}: compile filled({caller.__name__}, ...): {value.signature} is open")
        if (
            isinstance(value, BuiltinFunctionType) and value.__module__ == "builtins" and value not in COMPILED_BUILTINS
        ) or (isinstance(value, ModuleType) and value.__name__.partition(".")[0] not in COMPILED_MODULES):
            raise TypeError(
                f"{place(caller)}: {caller.__name__} uses {value.__name__}, which machine code cannot; to look at its "
                "values, run it as plain Python under a debugger (docs/add-a-solver.md)"
            )
        if type(value) is FunctionType and not hasattr(value, "is_instruction"):
            raise TypeError(
                f"{place(caller)}: the formula {caller.__name__} calls {value.__name__}, which is no formula: write "
                f"@formula, or @integer_formula, above it ({place(value)})"
            )
        return tuple(self._within(item, caller) for item in value) if type(value) is tuple else value


class Formulas:
    """The formulas of a module in a variant, as attributes."""

    def __init__(self, variant: Variant, module: ModuleType):
        self.variant, self._module = variant, module

    def __getattr__(self, name: str) -> Callable:
        formula = getattr(self._module, name)
        if not is_formula(formula):
            raise TypeError(
                f"{self._module.__name__}.{name} is no formula: write @formula, or @integer_formula, above it"
            )
        return self.variant(formula)


def features_of(parts: Iterable[str]) -> dict[str, bool]:
    """Return the features that a scene's `parts` switch on or leave off, by their names in FEATURES."""
    present = {part.replace("-", "_") for part in parts}
    return {name: name in present for name in FEATURES if name in OF_PARTS or name in present}


def plain_formulas(module: ModuleType, real: Real, features: Features | None = None) -> Formulas:
    """Return the formulas of a module as plain Python, in a precision; features that are not named are off."""
    return Variant(real, plain, _with_off(features)).of(module)


def _with_off(features: Features | None) -> dict[str, Feature]:
    """Return features with all others off."""
    return {**dict.fromkeys(FEATURES, False), **(features or {})}


def _unknown_feature(name: str) -> str:
    close = get_close_matches(name, FEATURES, 1)
    suggestion = f"did you mean {close[0]}? " if close else ""
    return f"FEATURE.{name} is unknown: {suggestion}A new feature is an entry of FEATURES in {__name__}"


def _asked(function: Marked, features: FeatureSet) -> FeatureSet:
    """Return the features that a formula's text names: variants that differ in others share its copy."""
    names = _definitions(inspect.getfile(function))[function.__name__][2]
    return frozenset(feature for feature in features if feature[0] in names)


@cache
def _specialised(
    function: Marked, features: FeatureSet, rounded: bool
) -> tuple[CodeType, frozenset[str], dict[str, float]]:
    """Return (code that defines a formula's copy, its global names, its float literals by the names they get)."""
    definition, constants = specialised_tree(function, features, rounded)
    tree = ast.fix_missing_locations(ast.Module([definition], []))
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    local = {node.id for node in nodes if isinstance(node.ctx, ast.Store)}
    local |= {node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)}
    names = frozenset(node.id for node in nodes) - local
    return compile(tree, inspect.getfile(function), "exec"), names, constants


def check_returns(function: Callable, count: int, features: Mapping[str, int] | None = None) -> None:
    """Raise TypeError if a formula is none, or a return statement of it has not `count` values."""
    if not is_formula(function):
        raise TypeError(f"{place(function)}: {function.__name__} is no formula: write @formula above it")
    values = [
        node.value
        for node in ast.walk(specialised_tree(function, frozenset(_with_off(features).items()), False)[0])
        if isinstance(node, ast.Return)
    ]
    while values:
        value = values.pop()
        if isinstance(value, ast.IfExp):
            values += [value.body, value.orelse]
        elif not isinstance(value, (ast.Call, ast.Name)):  # these may be tuples
            number = len(value.elts) if isinstance(value, ast.Tuple) else 1
            if number != count:
                file, line = function.__code__.co_filename, value.lineno if value else function.__code__.co_firstlineno
                where = f" with {features}" if features else ""
                raise TypeError(f"{file}:{line}: {function.__name__} returns {number} values{where}, not {count}")


@cache
def specialised_tree(function: Marked, features: FeatureSet, rounded: bool) -> tuple[ast.FunctionDef, dict[str, float]]:
    """Return (a copy of a formula's tree, its float literals by the names that replace them). Both are kept: read only."""
    line, text, _ = _definitions(inspect.getfile(function))[function.__name__]
    definition = parsed("\n" * (line - 1) + text).body[0]
    assert isinstance(definition, ast.FunctionDef)
    definition.returns = None
    for argument in (*definition.args.args, *definition.args.kwonlyargs):
        argument.annotation = None
    if ast.get_docstring(definition) is not None:
        del definition.body[0]
    specialise = _Specialise(dict(features), function, rounded)
    definition.body = specialise.block(definition.body)
    return definition, specialise.constants


def parsed(text: str) -> ast.Module:
    """Return the syntax tree of a text, in one thread at a time: CPython's count of its depth is common to all threads,
    and another thread's changes end it with a SystemError (https://github.com/python/cpython/issues/106905)."""
    with _PARSING:
        return ast.parse(text)


@cache
def _definitions(file: str) -> dict[str, tuple[int, str, frozenset[str]]]:
    """Return (first line, text, features that it names) of the functions of a file, without their decorators, by name."""
    with open(file, encoding="utf-8") as source:
        text = source.read()
    lines, functions = text.splitlines(), [node for node in parsed(text).body if isinstance(node, ast.FunctionDef)]
    found: dict[str, tuple[int, str, frozenset[str]]] = {}
    for node in functions:
        body = "\n".join(lines[node.lineno - 1 : node.end_lineno])
        found[node.name] = node.lineno, body, frozenset(re.findall(r"\bFEATURE\.(\w+)", body))
    return found


def _unpacked(items: list[ast.expr]) -> list[ast.expr]:
    """Return expressions with the elements of those that are tuples behind a star."""
    unpacked: list[ast.expr] = []
    for item in items:
        inner = item.value if isinstance(item, ast.Starred) else None
        unpacked += inner.elts if isinstance(inner, ast.Tuple) else [item]
    return unpacked


class _Specialise(ast.NodeTransformer):
    """Replaces features and literals of a formula by the constants of a variant."""

    def __init__(self, features: dict[str, Feature], function: Marked, rounded: bool):
        self.features, self.known, self.rounded = features, function.__globals__, rounded
        self.has_floats, self.file, self.name = (
            function.rounds_products, function.__code__.co_filename, function.__name__,
        )  # fmt: skip
        self.constants: dict[str, float] = {}

    def block(self, statements: list[ast.stmt]) -> list[ast.stmt]:
        """Return statements without those that are never executed."""
        live: list[ast.stmt] = []
        for statement in statements:
            visited = self.visit(statement)
            live += visited if isinstance(visited, list) else [visited]
            if live and isinstance(live[-1], ast.Return):
                break
        return live or [ast.copy_location(ast.Pass(), statements[0])]

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if isinstance(node.value, ast.Name) and node.value.id == "FEATURE":
            if node.attr not in FEATURES:
                raise AttributeError(f"{self._line(node)}: {_unknown_feature(node.attr)}")
            if node.attr not in self.features:
                raise AttributeError(
                    f"{self._line(node)}: {self.name} asks for FEATURE.{node.attr}, which its variant does not declare: "
                    "name it, True or False, where the kernel that calls it is compiled"
                )
            return ast.copy_location(ast.Constant(self.features[node.attr]), node)
        record = self.known.get(node.value.id) if isinstance(node.value, ast.Name) else None
        if hasattr(record, "_fields") and type(value := getattr(record, node.attr, None)) is int:
            return ast.copy_location(ast.Constant(value), node)
        if node.attr == "float64":
            self._refuse_float64(node)
        return self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        if isinstance(node.func, ast.Name) and node.func.id == "float":
            self._refuse_float64(node)
        if node.args and isinstance(node.args[0], ast.GeneratorExp) and ast.unparse(node.func) == "tuple":
            (loop,) = node.args[0].generators
            numbers = self._numbers(loop.iter)
            if numbers is not None:
                items = [self.visit(self._numbered(node.args[0].elt, loop.target, n)) for n in numbers]
                return ast.copy_location(ast.Tuple(items, ast.Load()), node)
        self.generic_visit(node)
        node.args = _unpacked(node.args)
        return node

    def visit_Tuple(self, node: ast.Tuple) -> ast.AST:
        """A tuple that is written out in a tuple is part of it: numba cannot unpack an empty one."""
        self.generic_visit(node)
        node.elts = _unpacked(node.elts)
        return node

    def _numbers(self, loop: ast.expr) -> range | None:
        """Return the numbers of a loop over `unrolled`, or None."""
        if not (isinstance(loop, ast.Call) and isinstance(loop.func, ast.Name) and loop.func.id == "unrolled"):
            return None
        bounds = [ast.unparse(self.visit(bound)) for bound in loop.args]
        return range(*(eval(bound, {"__builtins__": {}}, self.known) for bound in bounds))

    def _numbered(self, node: Node, target: ast.expr, number: int) -> Node:
        """Return a copy of a loop's body for one number."""
        assert isinstance(target, ast.Name)
        return _Numbered(target.id, number, self.known).visit(copy.deepcopy(node))

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        node.value = self.visit(node.value)
        rules = self.has_floats, self.rounded
        self.has_floats = self.rounded = False  # the index is an integer
        node.slice = self.visit(node.slice)
        self.has_floats, self.rounded = rules
        entry = self._entry(node)
        return ast.copy_location(ast.Constant(entry), node) if isinstance(entry, str) else node

    def _entry(self, node: ast.expr) -> object:
        """Return an entry of a constant table of the module at constant places, or None."""
        if isinstance(node, ast.Name):
            return self.known.get(node.id)
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
            table, place = self._entry(node.value), node.slice.value
            return table[place] if type(table) is tuple and type(place) is int else None
        return None

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        if type(node.value) is not float:
            return node
        name = f"_{node.value!r}".replace(".", "_").replace("-", "m").replace("+", "")
        self.constants[name] = node.value
        return ast.copy_location(ast.Name(name, ast.Load()), node)

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        if isinstance(node.op, (ast.Mult, ast.Div, ast.Pow)):
            self._refuse_integers(node, [node.left, node.right])
        elif isinstance(node.op, (ast.Add, ast.Sub)):
            self._refuse_integers(node, [node.left])  # `k + 1` counts, `1 - x` does not
        self.generic_visit(node)
        return self._product(node, node.left, node.right) if self.rounded and isinstance(node.op, ast.Mult) else node

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        if isinstance(node.op, (ast.Mult, ast.Div)):
            self._refuse_integers(node, [node.value])
        self.generic_visit(node)
        if not self.rounded or not isinstance(node.op, ast.Mult) or not isinstance(node.target, ast.Name):
            return node
        left = ast.copy_location(ast.Name(node.target.id, ast.Load()), node.target)
        return ast.copy_location(ast.Assign([node.target], self._product(node, left, node.value)), node)

    def _product(self, node: ast.AST, left: ast.expr, right: ast.expr) -> ast.Call:
        return ast.copy_location(ast.Call(ast.Name(PRODUCT, ast.Load()), [left, right], []), node)

    def _refuse_integers(self, node: ast.expr | ast.stmt, operands: list[ast.expr]) -> None:
        for operand in operands:
            number = operand.operand if isinstance(operand, ast.UnaryOp) else operand
            if self.has_floats and isinstance(number, ast.Constant) and type(number.value) is int:
                raise TypeError(
                    f"{self._line(node)}: `{ast.unparse(node)}`: an integer literal makes a float32 a float64; write "
                    f"{ast.unparse(operand)}.0, or @integer_formula above a function of integers"
                )

    def _refuse_float64(self, node: ast.expr) -> None:
        if self.has_floats:
            raise TypeError(
                f"{self._line(node)}: `{ast.unparse(node)}` is a float64; write real(...), or a literal like 1.0"
            )

    def _line(self, node: ast.expr | ast.stmt) -> str:
        return f"{self.file}:{node.lineno}"

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        """A feature compared with a number or with a constant of the module is a constant."""
        of_feature = isinstance(node.left, ast.Attribute)
        self.generic_visit(node)
        if of_feature and isinstance(node.left, ast.Constant) and type(node.ops[0]) in COMPARED:
            right = node.comparators[0]
            value = self.known.get(right.id) if isinstance(right, ast.Name) else getattr(right, "value", None)
            if isinstance(value, (int, str)) and not isinstance(value, CountOfPrecision) and len(node.ops) == 1:
                return ast.copy_location(ast.Constant(COMPARED[type(node.ops[0])](node.left.value, value)), node)
        return node

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        self.generic_visit(node)
        decides = isinstance(node.op, ast.Or)  # the constant that decides the whole
        values: list[ast.expr] = []
        for value in node.values:
            if not (isinstance(value, ast.Constant) and isinstance(value.value, bool)):
                values.append(value)
            elif value.value is decides:
                values.append(value)
                break
        if not values:
            return ast.copy_location(ast.Constant(not decides), node)
        return values[0] if len(values) == 1 else ast.copy_location(ast.BoolOp(node.op, values), node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.op, ast.Not) and isinstance(node.operand, ast.Constant):
            return ast.copy_location(ast.Constant(not node.operand.value), node)
        return node

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.stmt]:
        test = self.visit(node.test)
        if isinstance(test, ast.Constant):
            chosen = node.body if test.value else node.orelse
            return self.block(chosen) if chosen else []
        node.test, node.body = test, self.block(node.body)
        node.orelse = self.block(node.orelse) if node.orelse else []
        return node

    def visit_For(self, node: ast.For) -> ast.AST | list[ast.stmt]:
        numbers = self._numbers(node.iter)
        if numbers is not None:
            return [self.visit(self._numbered(one, node.target, n)) for n in numbers for one in node.body]
        node.target, node.iter, node.body = self.visit(node.target), self.visit(node.iter), self.block(node.body)
        return node

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        test = self.visit(node.test)
        if isinstance(test, ast.Constant):
            return self.visit(node.body if test.value else node.orelse)
        node.test, node.body, node.orelse = test, self.visit(node.body), self.visit(node.orelse)
        return node


class _Numbered(ast.NodeTransformer):
    """Replaces a name by a number and evaluates constant expressions with it, because an index of a tuple has to be a
    literal."""

    def __init__(self, name: str, number: int, known: Mapping[str, object]):
        self.name, self.number, self.known = name, number, known

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return ast.copy_location(ast.Constant(self.number), node) if node.id == self.name else node

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        names = [part for part in ast.walk(node) if isinstance(part, ast.Name)]
        constant = all(name.id.isupper() and type(self.known.get(name.id)) is int for name in names)
        parts = (ast.BinOp, ast.Constant, ast.Name, ast.operator, ast.expr_context)
        if constant and all(isinstance(part, parts) for part in ast.walk(node)):
            return ast.copy_location(ast.Constant(eval(ast.unparse(node), {"__builtins__": {}}, self.known)), node)
        return node
