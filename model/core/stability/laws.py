"""Laws of mechanics that a scheme violates, each with its bound and source.

Used by the notes of a run (`limit_notes`), by docs/limits.md and by the tests of the laws (tests/laws), which check every
solver against its bound. Solvers obey all laws without an entry.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

from softlab.model.core.families import family_of
from softlab.model.formulas.elastic.friction import SLIP
from softlab.model.scene.scene import Scene

RESTS = 0.03  # every scheme comes to rest if gravity moves a particle by at most so many rest distances per substep


@dataclass(frozen=True)
class Limit:
    """A law that a scheme violates, and the bound of the violation.

    `law`: its name (tests/laws/law.py). `applies(scene)`: True if the scene's scheme violates it. `bound`: the violation
    in words; `source`: the equation, paper or page that it follows from; `part`: the bound as a number, if the test of
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
        f"rigid bodies lose spin as omega0 / sqrt(1 + omega0^2 h t): one turn per second decays to {100 * left:.1f} % "
        f"within a second at this substep ({h:.3g} s); use more substeps to lose less"
    )


def _creep_note(scene: Scene) -> str:
    """Return the note on the creep of tetrahedra under friction, which acts like a dashpot."""
    pulled = scene.gravity is not None and scene.gravity.enabled
    if not pulled or not any(one.dynamic_friction > 0 for _, one in scene.colliders):
        return ""
    return (
        f"with vbd, friction of colliders is a dashpot below {1e3 * SLIP:g} mm/s: what should stick on a slope of angle a "
        f"creeps at {1e3 * SLIP:g} mm/s times tan a / dynamic_friction; with xpbd and newton it sticks"
    )


AVERAGING = "M. Macklin and others, Unified particle physics for real-time applications (2014), on averaging"
LIMITS: tuple[Limit, ...] = (
    Limit(
        "half the acceleration", "fall", _integrates("lab"),
        "y = -g dt^2 n(n+1)/4: half of g, at any step size", "docs/method/grids.md, the hand-out's own step",
        note=lambda scene: (
            "the step of the hand-out (lab) integrates half of the acceleration: at any step size masses fall half as far "
            "and oscillate 1.41 times as slowly; semi-implicit-euler is the same step with the whole acceleration"
        ),
    ),
    Limit(
        "half a kick at rest", "rest",
        lambda scene: bool(scene.cloth) and _integrates("velocity-verlet")(scene),
        "a mass at rest on a collider keeps its position but reports the velocity g h/2 of its second half kick",
        "docs/method/grids.md, contact: colliders act on the velocity of the half step", part=0.5,
    ),
    Limit(
        "weight of a rigid body", "rest", _has_rigid_body,
        "at rest a body overlaps a collider by g h^2/f, f the fraction of its mass in contact: of second order in the "
        "substep h",
        "contact corrects the fraction f of the mass, gravity moves all of it by g h^2, and rigid goals average both",
        part=2.0,
    ),
    Limit(
        "friction after the solve", "rest", lambda scene: bool(scene.tetrahedra) and scene.method.solver == "vbd",
        "a sheared body on a floor slides by h^2 times the acceleration of its shear in each substep, at most mu g h^2 M/m "
        "(m: mass in contact, M: whole mass)",
        "docs/method/tetrahedra.md: descents move particles that stick, and friction reverts only their velocity",
    ),
    Limit(
        "friction by a dashpot", "friction", _descends,
        f"what should stick creeps at SLIP = {SLIP:g} m/s times the fraction of mu p_n that supports it (tan a / mu on a "
        "slope), for any h; with 15 sweeps of 1/60 s a ninth faster. mu is the dynamic coefficient",
        "p_t = mu p_n |u| / (SLIP h) for a slip |u| < SLIP h per substep: model/formulas/elastic/friction.py, after M. Li "
        "and others, Incremental Potential Contact (2020), section 5",
        note=_creep_note,
    ),
    Limit(
        "explicit Euler gains energy", "energy", _integrates("explicit-euler", "taylor"),
        "at most by the factor 1 + (h w)^2 per step, w the highest frequency",
        "model/core/integrators.py, amplification_matrix",
        note=lambda scene: f"{scene.method.integrator} gains energy in every step unless dampers remove more",
    ),
    Limit(
        "symplectic oscillation", "energy", _integrates(*SYMPLECTIC),
        "the energy oscillates within a factor (1 + h w/2)/(1 - h w/2) of the initial one (semi-implicit Euler, lab), or "
        "1/(1 - (h w)^2/4) (velocity Verlet)",
        "E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), I.1.4 and IX.8: they conserve another "
        "energy",
    ),
    Limit(
        "linear solve", "momentum", _integrates("implicit-euler-linear"),
        "conserved to 1e-6 of the momentum that a step exchanges",
        "model/formulas/implicit.py, LINEAR_TOLERANCE of the residual",
        part=1e-6,
    ),
    Limit(
        "averaged corrections", "momentum", _averages,
        "a fraction of up to 1 - 1/valence of the exchanged momentum is lost: the corrections of the two ends of a spring "
        "are divided by different numbers",
        f"docs/method/positions.md, orderings; {AVERAGING}", part=1.0,
        note=lambda scene: "averaged-jacobi loses momentum; jacobi and gauss-seidel conserve it",
    ),
    Limit(
        "averaged corrections with a lever", "angular momentum", _averages,
        "lost as linear momentum is, times the lever arm", "docs/method/positions.md, orderings", part=1.0,
    ),
    Limit(
        "averaged forces", "force", lambda scene: _averages(scene) and scene.method.solver == "xpbd",
        "the displacement by a force f is divided by the number of constraints at the mass, as if the stiffness were another",
        "docs/method/positions.md, orderings",
        part=1.0,
    ),
    Limit(
        "displacements without energy", "energy", lambda scene: _averages(scene) and scene.method.solver == "xpbd",
        "the energy may double within ten steps: displacements are not the gradient of an energy",
        "docs/method/positions.md, orderings",
        part=1.0,
    ),
    Limit(
        "averaged stiffness", "limit", lambda scene: _averages(scene) and scene.method.solver == "xpbd",
        "iterations converge to another stiffness, so a part of the first residual remains",
        "docs/method/positions.md, orderings", part=1.0,
    ),
    Limit(
        "linear goals", "force", _is_linear,
        "the force of goals with `linear` b is not the gradient of an energy: it differs from the slope of the reported "
        "energy by the fraction b (1 - b), at most 1/4, of the force that the same shear causes without `linear`",
        "b F / cbrt(det F) has no symmetric derivative; to first order goals resist a shear with (1 - b) w^2, and w^2 |x - "
        "goal|^2 / 2 has (1 - b)^2", part=0.25,
    ),
    Limit(
        "limit of linear goals", "limit", _is_linear,
        "iterations converge to a balance of these forces, which differ by as much from the slope of the reported energy",
        "as for the force", part=0.25,
    ),
    Limit(
        "sweeps of descent", "momentum", _descends,
        "conserved to 1e-3 of the exchanged momentum with four sweeps; for surfaces in contact to 2e-2, and to 1e-3 with 16",
        "vertices move one by one, and momentum is conserved when all gradients are zero; "
        "tests/tetrahedra/vbd/test_vbd_contact.py",
        part=1e-3,
    ),
    Limit(
        "sums over all bodies", "bystanders",
        lambda scene: bool(scene.tetrahedra) and scene.method.solver == "newton",
        "the same to rounding, not to the bit: each step depends on scalar products over all bodies",
        "model/formulas/elastic/newton.py: conjugate gradients over all particles of a scene",
    ),
    Limit(
        "greedy colours", "bystanders", _has_greedy_colours,
        "the same only in the limit of many iterations: the greedy colouring takes the constraints of all bodies in one "
        "random order, so another body changes the order of projections",
        "model/geometry/colouring.py; all orders of Gauss-Seidel converge to the same limit, M. Macklin and others, XPBD "
        "(2016)",
        part=1.0,
    ),
    Limit(
        "spin of rigid bodies", "angular momentum", _has_rigid_body,
        "omega(t) = omega0 / sqrt(1 + omega0^2 h t), h the substep",
        "from tan(D') = sin D of the angles D, D' of two substeps; model/formulas/shape_matching/rigid.py",
        note=_spin_note,
    ),
    Limit(
        "position at the end of a substep", "angular momentum", lambda scene: not _integrates(*SYMPLECTIC)(scene),
        "a substep changes it by at most h sum m |v| |dv|: a body that turns at w loses w^2 h of its spin per second "
        "(measured: 0.93 to 1 of that; taylor half, rk4 none)",
        "forces act at positions x* within the substep, up to h v from those at its end: sum (x - x*) cross m dv; "
        "docs/method/cases.md, A8",
    ),
    Limit(
        "pressure without warm start", "rest",
        lambda scene: bool(scene.fluids) and scene.method.scheme != "macklin",
        "without gravity the lattice stays at rest. With gravity water comes to rest if that moves a particle by at most "
        f"{RESTS:g} rest distances per substep (g h^2 / d); a run prints a note for longer substeps, and advise leaves them "
        "out",
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
