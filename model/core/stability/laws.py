"""Laws that a scheme cannot fulfil although its solver otherwise does, each once with its bound and source.

The notes of a run (`limit_notes`), docs/limits.md and the tests of the laws (tests/laws) use them; the tests check
every solver against its bound. Laws without an entry are fulfilled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

from softlab.model.core.families import family_of
from softlab.model.formulas.elastic.friction import SLIP
from softlab.model.scene.scene import Scene

RESTS = 0.03  # rest distances by which gravity moves a particle in a substep, up to which every scheme comes to rest


@dataclass(frozen=True)
class Limit:
    """A violated law and its bound.

    `law`: its name (tests/laws/law.py). `applies(scene)`: True if the scene's scheme violates it. `bound`: the scheme's
    own law, a clause; `source`: the equation, paper or page that it follows from; `part`: the bound as a number, where
    the law needs one. `note(scene)`: a note for the user, or "".
    """

    name: str
    law: str
    applies: Callable[[Scene], bool]
    bound: str
    source: str
    part: float = 0.0
    note: Callable[[Scene], str] = lambda scene: ""


def _averages(scene: Scene) -> bool:
    return scene.method.solver in ("xpbd", "pbd") and scene.method.ordering == "averaged-jacobi"


def _integrates(*names: str) -> Callable[[Scene], bool]:
    return lambda scene: scene.method.solver == "mass-spring" and scene.method.integrator in names


SYMPLECTIC = ("lab", "semi-implicit-euler", "velocity-verlet")


def _descends(scene: Scene) -> bool:
    return (bool(scene.tetrahedra) and scene.method.solver == "vbd") or (
        scene.is_world and scene.method.tetrahedra == "vbd"
    )


def _has_greedy_colours(scene: Scene) -> bool:
    cut_to_fit = any(
        part.sweep == "tetrahedra" or part.tetrahedra == "conforming" for part in scene.tetrahedra.values()
    )
    return scene.method.solver == "xpbd" and cut_to_fit


def _has_rigid_body(scene: Scene) -> bool:
    return any(kind == "rigid_body" for kind in scene.kinds.values())


def _is_linear(scene: Scene) -> bool:
    return any(getattr(part, "linear", 0.0) > 0 for part in scene.parts.values())


def _spin_note(scene: Scene) -> str:
    """Return the note on rigid bodies that rotate: how much of a rotation is left after a second."""
    h = scene.method.dt / scene.method.substeps
    left = 1 / (1 + (2 * pi) ** 2 * h) ** 0.5
    if left > 0.99:
        return ""
    return (
        f"rigid bodies lose spin as omega0 / sqrt(1 + omega0^2 h t): of a turn a second {100 * left:.1f} % is left after a "
        f"second at this substep ({h:.3g} s); more substeps keep more"
    )


def _creep_note(scene: Scene) -> str:
    """Return the note on the creep of tetrahedra under friction, which acts like a dashpot."""
    pulled = scene.gravity is not None and scene.gravity.enabled
    if not pulled or not any(one.dynamic_friction > 0 for _, one in scene.colliders):
        return ""
    return (
        f"friction of colliders is a dashpot below {1e3 * SLIP:g} mm/s under vbd: what sticks on a slope of the angle a "
        f"creeps at {1e3 * SLIP:g} mm/s times tan a over dynamic_friction; xpbd and newton hold it"
    )


AVERAGING = "M. Macklin and others, Unified particle physics for real-time applications (2014), on averaging"
LIMITS: tuple[Limit, ...] = (
    Limit(
        "half the acceleration", "fall", _integrates("lab"),
        "y = -g dt^2 n(n+1)/4: half of g, at any step size", "docs/method/grids.md, the hand-out's own step",
        note=lambda scene: (
            "the step of the hand-out (lab) integrates half of the acceleration: masses fall half as far and swing 1.41 "
            "times as slowly, at any step size; semi-implicit-euler is the same step with all of it"
        ),
    ),
    Limit(
        "half a kick at rest", "rest",
        lambda scene: bool(scene.cloth) and _integrates("velocity-verlet")(scene),
        "what lies on a collider keeps its place, and reports the velocity g h/2 of its second half kick",
        "docs/method/grids.md, contact: colliders take from the half-step velocity", part=0.5,
    ),
    Limit(
        "weight of a rigid body", "rest", _has_rigid_body,
        "lies g h^2/f deeper than it touches, f the part of its mass that does: of second order in the substep h",
        "contact takes back its depth from the mass f, gravity adds g h^2 to all of it; rigid goals share both",
        part=2.0,
    ),
    Limit(
        "friction after the solve", "rest", lambda scene: bool(scene.tetrahedra) and scene.method.solver == "vbd",
        "what lies on a floor and is sheared goes on by h^2 times that, mu g h^2 M/m a substep at most, m the mass that lies "
        "there, M all of it",
        "docs/method/tetrahedra.md: descents move what sticks, and friction takes back the velocity",
    ),
    Limit(
        "friction by a dashpot", "friction", _descends,
        f"what sticks creeps at SLIP = {SLIP:g} m/s times the part of mu p_n that holds it (on a slope tan a / mu), "
        "whatever h, and a ninth faster with 15 sweeps of 1/60 s; mu is the dynamic coefficient",
        "p_t = mu p_n |u| / (SLIP h) for a slip |u| < SLIP h in a substep: model/formulas/elastic/friction.py, after M. Li "
        "and others, Incremental Potential Contact (2020), section 5",
        note=_creep_note,
    ),
    Limit(
        "explicit Euler gains energy", "energy", _integrates("explicit-euler", "taylor"),
        "at most the factor 1 + (h w)^2 a step, w the fastest vibration", "model/core/integrators.py, amplification_matrix",
        note=lambda scene: f"{scene.method.integrator} gains energy in every step unless dampers take more away",
    ),
    Limit(
        "symplectic wobble", "energy", _integrates(*SYMPLECTIC),
        "bounded: within (1 + h w/2)/(1 - h w/2) of the start (semi-implicit Euler, lab), 1/(1 - (h w)^2/4) (velocity "
        "Verlet)",
        "E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), I.1.4 and IX.8: they keep another energy",
    ),
    Limit(
        "linear solve", "momentum", _integrates("implicit-euler-linear"),
        "to 1e-6 of the momentum that a step exchanges", "model/formulas/implicit.py, LINEAR_TOLERANCE of the residual",
        part=1e-6,
    ),
    Limit(
        "averaged corrections", "momentum", _averages,
        "loses up to the part 1 - 1/valence of what is exchanged: corrections of both ends are divided by different counts",
        f"docs/method/positions.md, orderings; {AVERAGING}", part=1.0,
        note=lambda scene: "averaged-jacobi loses momentum; jacobi and gauss-seidel keep it",
    ),
    Limit(
        "averaged corrections turn", "angular momentum", _averages,
        "as its linear momentum, times the arm", "docs/method/positions.md, orderings", part=1.0,
    ),
    Limit(
        "averaged forces", "force", lambda scene: _averages(scene) and scene.method.solver == "xpbd",
        "a displacement of f/m over the number of constraints at a mass: another stiffness",
        "docs/method/positions.md, orderings",
        part=1.0,
    ),
    Limit(
        "averaged corrections gain", "energy", lambda scene: _averages(scene) and scene.method.solver == "xpbd",
        "may double within ten steps: what it moves masses by is no gradient of an energy",
        "docs/method/positions.md, orderings",
        part=1.0,
    ),
    Limit(
        "averaged corrections converge elsewhere", "limit", lambda scene: _averages(scene) and scene.method.solver == "xpbd",
        "to another stiffness, so that part of the first residual stays", "docs/method/positions.md, orderings", part=1.0,
    ),
    Limit(
        "linear goals", "force", _is_linear,
        "the force of goals with `linear` b is no gradient of an energy: it differs from the slope of the "
        "reported one by b (1 "
        "- b), 1/4 at most, of what the same shear makes without `linear`",
        "b F / cbrt(det F) has no symmetric derivative; to first order goals resist a shear with (1 - b) w^2, and w^2 |x - "
        "goal|^2 / 2 has (1 - b)^2", part=0.25,
    ),
    Limit(
        "linear goals converge elsewhere", "limit", _is_linear,
        "to where the force is balanced, which is off by as much from the slope of the reported energy",
        "as for the force", part=0.25,
    ),
    Limit(
        "sweeps of descent", "momentum", _descends,
        "lacks what sweeps leave undone: 1e-3 of what is exchanged with four of them; 2e-2 where surfaces meet, 1e-3 with 16",
        "vertices are moved one by one, until all gradients are zero; tests/tetrahedra/vbd/test_vbd_contact.py",
        part=1e-3,
    ),
    Limit(
        "sums over all bodies", "bystanders",
        lambda scene: bool(scene.tetrahedra) and scene.method.solver == "newton",
        "the same to rounding, not to the bit: products of all bodies' residuals decide each step",
        "model/formulas/elastic/newton.py: conjugate gradients over all particles of a scene",
    ),
    Limit(
        "greedy colours", "bystanders", _has_greedy_colours,
        "differs by what sweeps leave undone: the greedy colouring of a scene takes all bodies' constraints in one random "
        "order, so that another body changes the order of projections",
        "model/geometry/colouring.py; orders of Gauss-Seidel lead to the same limit, M. Macklin and others, XPBD (2016)",
        part=1.0,
    ),
    Limit(
        "spin of rigid bodies", "angular momentum", _has_rigid_body,
        "omega(t) = omega0 / sqrt(1 + omega0^2 h t), h the substep",
        "from tan(D') = sin D of the angles D, D' of two substeps; model/formulas/shape_matching/rigid.py",
        note=_spin_note,
    ),
    Limit(
        "lever of a substep", "angular momentum", lambda scene: not _integrates(*SYMPLECTIC)(scene),
        "a substep changes it by h sum m |v| |dv| at most: a body that turns loses w^2 h of its spin a second "
        "(0.93 to 1 of that measured; taylor half, rk4 none)",
        "forces act where particles are within the substep, h v from where it ends: sum (x - x*) cross m dv; NUMERICS A8",
    ),
    Limit(
        "pressure anew in each substep", "rest",
        lambda scene: bool(scene.fluids) and scene.method.scheme != "macklin",
        "keeps its lattice without weight; with it water comes to rest where gravity moves a particle by at most "
        f"{RESTS:g} rest distances in a substep (g h^2 / d); a run notes longer ones, and advise leaves them out",
        "docs/limits.md, fluids at rest; model/fluid/family.py, comes_to_rest",
        note=lambda scene: family_of(scene).scheme_note(scene),
    ),
)  # fmt: skip


def limits_of(scene: Scene) -> list[Limit]:
    """Return the limits of the scene's scheme."""
    return [limit for limit in LIMITS if limit.applies(scene)]


def limit_notes(scene: Scene) -> list[str]:
    """Return the notes of a run of the scene on its scheme's limits."""
    return [note for limit in limits_of(scene) if (note := limit.note(scene))]
