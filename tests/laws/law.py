"""The laws: their equations, the cases that a row is asked in, and why a law does not apply to a row.

What a scheme cannot keep stands in model/core/stability/laws.py, once; the page docs/limits.md is written from both
(tests/laws/limits_page.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rows import SHEETS, Row

from softlab.model.core.stability.laws import Limit, limits_of

Words = tuple[str, ...]


def everywhere(row: Row) -> str:
    """No reason against it."""
    return ""


def once(row: Row) -> Words:
    """One case."""
    return ("",)


@dataclass(frozen=True)
class Law:
    """`title` and `equation` for the page. `absent(row)`: why the law does not apply to the row, or "". `cases(row)`:
    in which ways it is asked. `resolved`: whether float32 resolves what is measured."""

    name: str
    title: str
    equation: str
    absent: Callable[[Row], str] = everywhere
    cases: Callable[[Row], Words] = once
    resolved: bool = True
    precise: bool = True


COLLIDERS = ("plane", "sphere", "capsule", "box", "mesh_collider", "distance_field")


def has_sheet(row: Row) -> bool:
    """Whether its particles are one sheet."""
    return any(row.bare.kinds[name] in SHEETS for name in row.bare.kinds) and row.family != "world"


def without_colliders(row: Row) -> str:
    """A reason, or ""."""
    if not row.meets_colliders:
        return "a grid in the plane has no colliders"
    return ""


def unsteady(row: Row) -> str:
    """Why it does not lie on a collider."""
    if row.bare.fluids or (row.bare.is_world and row.bare.members.get("fluid")):
        return "a fluid spreads on an open floor; [fluids at rest](#fluids-at-rest) has its rest in a tank"
    if row.bare.method.order == 2 and row.solver == "newton":
        return "the scheme refuses colliders"
    return without_colliders(row)


def of_rest(row: Row) -> Words:
    """Unloaded, on each kind of collider, and after sliding."""
    slid = ("after sliding",) if row.family != "world" else ()
    ball = "volume" in row.tables  # which stands on one vertex, and rolls
    return ("unloaded", *(() if unsteady(row) or ball else (*COLLIDERS, *slid)))


def without_energy(row: Row) -> str:
    """Why no energy can be asked for."""
    if row.solver == "pbd":
        return "pbd has no stiffness: its response to a stretch depends on iterations and dt (docs/method/positions.md)"
    return ""


def without_gradient(row: Row) -> str:
    """Why no force can be held against an energy."""
    if row.bare.fluids or (row.bare.is_world and row.bare.members.get("fluid")):
        return "the density constraint of a fluid is rigid and one-sided: it stores no energy"
    if row.name == "rigid_body":
        return "a rigid body stores no energy"
    return without_energy(row)


def without_damper(row: Row) -> str:
    """Why a row has no damping of its material."""
    return "" if row.damper else "the material has no damping (a `[damping]` table slows falls and turns by definition)"


def of_symmetry(row: Row) -> Words:
    """Shifted, turned; mirrored where nothing is handed (goals are rotations, volumes of tetrahedra have a sign, so that
    a mirrored state is one inside out); renumbered where two bodies can change places."""
    handed = row.solver == "shape-matching" or "volume" in row.tables
    mirrored = (row.body in SHEETS or bool(row.bare.fluids)) and not handed and row.family != "world"
    return ("shifted", "turned", *(["mirrored"] * mirrored), *(["renumbered"] * (not alone(row))))


def alone(row: Row) -> str:
    """Why a row has no bystanders."""
    return "a scene has only one sheet" if has_sheet(row) else ""


def without_live_stiffness(row: Row) -> str:
    """Why no stiffness can be changed while it runs."""
    if row.solver == "pbd":
        return "pbd has no stiffness"
    if not ("springs" in row.tables or "structural" in row.tables) or row.family == "world":
        return "the material cannot be changed during a run"
    return ""


def without_implicit_limit(row: Row) -> str:
    """Why iterations have no limit to go to."""
    if row.solver == "mass-spring" and not row.bare.method.integrator.startswith("implicit-euler"):
        return "an explicit integrator has no iterations"
    if row.bare.fluids or "fluid" in getattr(row.bare, "members", {}):
        return "the density constraint is an inequality without energy; `softlab fluids --truth` measures its error"
    if row.name == "rigid_body":
        return "a single projection is exact"
    if row.bare.method.order == 2:
        return "a substep has two solves and is no implicit Euler step (tests/finite_elements/test_newton_order.py)"
    return without_energy(row)


def of_trace(row: Row) -> Words:
    """Save and load, reset; bodies come and go."""
    return ("saved", "reset", *(["added and removed"] * (row.family == "bodies")))


def without_slope(row: Row) -> str:
    """Why it does not slide on a plane."""
    return unsteady(row)


def without_rebound(row: Row) -> str:
    """Why it does not land flat, all at once."""
    if row.bare.tetrahedra or row.family == "world" or "volume" in row.tables:
        return "a body with an interior stores a part of an impact and releases it"
    return unsteady(row)


LAWS = (
    Law("rest", "Rest stays at rest", "x(t) = x(0), v = 0", cases=of_rest),
    Law(
        "fall", "Free fall and straight flight", "y = -g h^2 n(n+1)/2 without strain; x = v t, also if dt changes",
        cases=lambda row: ("fall", "flight", "flight while dt changes"),
    ),
    Law("momentum", "Linear momentum", "sum m v is constant"),
    Law("angular momentum", "Angular momentum", "sum m x cross v is constant"),
    Law("force", "Force is -grad of the reported energy", "m a = -dE/dx", absent=without_gradient, resolved=False),
    Law("energy", "No energy without a source", "E(t) <= E(0)", absent=without_energy),
    Law(
        "damping", "A material's damping slows neither a fall nor a turn", "height and angular momentum as without damping",
        absent=without_damper, cases=lambda row: ("fall", "turn"),
    ),
    Law(
        "symmetry", "The same motion when shifted, turned, mirrored, renumbered", "step(T x) = T step(x)",
        cases=of_symmetry,
    ),
    Law(
        "similarity", "The same bits in other units of length, time and mass", "powers of two: x -> a x, same mantissas",
        cases=lambda row: ("length", "time", "mass"), precise=False,
    ),
    Law("far", "The same motion far from the origin", "error of a few units in the last place of the coordinate"),
    Law("bystanders", "Bodies without contacts are independent", "another body changes no bit", absent=alone, precise=False),
    Law("trace", "Save, load, reset, add and remove leave no trace", "same bits", cases=of_trace, precise=False),
    Law(
        "live", "A change of stiffness during a run keeps position and velocity", "x, v continuous; |x' - x - h v| <= h^2 a",
        absent=without_live_stiffness,
    ),
    Law(
        "limit", "Iterations lead to the implicit solution", "M (x - y)/h^2 + grad E -> 0",
        absent=without_implicit_limit, resolved=False,
    ),
    Law("friction", "Coulomb's cone", "|p_t| <= mu p_n; sliding: |p_t| = mu_d p_n", absent=without_slope,
        cases=lambda row: ("slides", "sticks")),
    Law(
        "rebound", "Restitution", "v' = e v, so heights are e^2 times as large; none for e = 0", absent=without_rebound,
        cases=lambda row: ("0", "0.5", "1"),
    ),
)  # fmt: skip
BY_NAME = {law.name: law for law in LAWS}


def of(name: str) -> Callable[[Any], Any]:
    """Mark a test body as that of a law; tests/laws/conftest.py hands it rows, cases and labs."""

    def marked(test: Any) -> Any:
        test.law = BY_NAME[name]
        return test

    return marked


def limit_of(law: str, row: Row) -> Limit | None:
    """What the row's scheme cannot keep of the law, or None."""
    return next((one for one in limits_of(row.bare) if one.law == law), None)
