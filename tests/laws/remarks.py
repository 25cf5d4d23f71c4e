"""What was measured of solvers beside the matrix of laws: written into docs/limits.md, each with where it is tested or
described."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Remark:
    """`subject`: which solvers; `text`: a clause with its units; `source`: a page, a file or an equation."""

    subject: str
    text: str
    source: str


TETRAHEDRA = "docs/method/tetrahedra.md, tetrahedra"
MEETING = "docs/method/tetrahedra.md, tetrahedral bodies that meet"
CONTACT = "docs/method/grids.md, contact"
REMARKS: tuple[Remark, ...] = (
    Remark(
        "clusters of a grid",
        "of a spin omega0 [1/s] omega0 / sqrt(1 + 2 omega0^2 h t) is left at t [s], h [s] the substep: twice "
        "the loss of a rigid "
        "body, whose velocities come from its momenta",
        "tan(D') = sin D / (2 - cos D) of the angles of two substeps; NUMERICS A8",
    ),
    Remark(
        "rigid bodies that meet",
        "with restitution 0 those that meet flat do not part; those whose particles lie between each other's part "
        "at up to 0.02 of the speed at which they met",
        "docs/method/grids.md, restitution of particles: two bricks at 1 m/s",
    ),
    Remark(
        "bodies of particles that rub",
        "a step within an impact may gain up to 2 % of the energy at first, at a coefficient of 2, as slip is measured "
        "between middles and friction acts where particles touch; no impact of two or three had more than at first",
        "tests/shape_matching/test_friction_couples.py: 30 impacts",
    ),
    Remark(
        "tetrahedra, newton order 2",
        "a turn of w [1/s] loses up to 0.42 w^2 h of its spin a second; of order 1 and by vbd as implicit Euler, w^2 h",
        "tests/public/test_newton_208.py; docs/method/tetrahedra.md, second order in time",
    ),
    Remark(
        "tetrahedra, newton and vbd: damping",
        "a Kelvin-Voigt damper in Green's strain: at the stretch s its modulus is up to s^4 times that at "
        "rest, and 0 where a "
        "tetrahedron is flat",
        "E = (s^2 - 1)/2, so that dE/dt = s^2 d(ln s)/dt, and the stress per volume at rest that goes with "
        "d(ln s)/dt is s^2 times "
        "that which goes with dE/dt",
    ),
    Remark(
        "tetrahedra, vbd: friction",
        "needs as many sweeps as the normal forces: on a slope of tan a = 1.5 mu, one substep a frame, a cube "
        "(1e5 Pa) sticks with "
        "4 sweeps, gains half of its acceleration with 10 and all of it with 30",
        TETRAHEDRA,
    ),
    Remark(
        "tetrahedra, xpbd neo-hookean with volume = \"voxels\"",
        "within 2 % of the force of its energy at strains of a quarter, with few iterations",
        "measured against the slope of the reported energy; model/formulas/constraints/tetrahedron_hookean.py",
    ),
    Remark(
        "tetrahedra, xpbd scalar rows of |F - R|",
        "end some per cent off the step of implicit Euler, however many iterations: their one direction is "
        "taken at an iterate; "
        "rows = \"blocks\" end at it",
        TETRAHEDRA,
    ),
    Remark(
        "tetrahedra, xpbd neo-hookean",
        "squeezed evenly to less than J = 0.16 of the volume, the shape's row falls into a point",
        "model/formulas/constraints/tetrahedron_hookean.py",
    ),
    Remark(
        "tetrahedra, xpbd: damping",
        "more than sweeps resolve holds up loads at rest: with tau h E / (rho e^2) over the iterations (e the mean edge) at "
        "1, 2, 3 and 5 the lowest tetrahedra of a ball (0.5 m, 3e5 Pa) on a floor keep 0.75, 0.7, 0.6 and 0.4 of their "
        "volume; a run says so above 5",
        "measured; model/core/stability/damping.py",
    ),
    Remark(
        "tetrahedra, xpbd with few substeps",
        "some may turn inside out on an impact; a run counts those that are so at its end, and exits with 1",
        "app/outcome.py; docs/method/cases.md, A10: bodies that are turned inside out find their shape again",
    ),
    Remark(
        "tetrahedra, xpbd on a slope",
        "soft bodies that begin prestressed slide 24 to 27 mm further in a second than Coulomb's law lets a "
        "stiff one, at tan a = "
        "1.1 mu (1e5 Pa, settled at mu = 5)",
        "measured; friction on positions, M. Mueller and others, Detailed rigid body simulation (2020), eq. 30",
    ),
    Remark(
        "grids and cloths of rows and columns, xpbd",
        "friction acts on velocities alone: what sticks on a slope of the angle a creeps down at g h sin a [m/s]",
        CONTACT,
    ),
    Remark(
        "surfaces that rub",
        "angular momentum: a part of friction's moment is left where `distance` exceeds the height of a triangle",
        MEETING,
    ),
    Remark(
        "particles that are caught",
        "are not looked for among more than 200 000 particles, nor inside colliders",
        "model/contact/shortfalls.py, MAX_PARTICLES",
    ),
    Remark(
        "position-based solvers",
        "lose gravity where a unit in the last place of a coordinate exceeds what it moves in a substep, g "
        "h^2 [m]; a note of the "
        "run says so",
        "x + (v + g h) h rounds to x + v h; model/core/stability/resolution.py",
    ),
    Remark(
        "other processors",
        "states of `exact` math are the same to the bit; drawn skins, stresses and the step-size limit may "
        "differ by rounding",
        "the order of operations of NumPy's products and eigenvalues is the processor's; tests/machines",
    ),
)  # fmt: skip
