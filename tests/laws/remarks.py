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
        "with restitution 0 those that meet flat do not part; those whose particles lie between each other's, with normals a "
        "off the way, part at up to sin(a)^4 of the speed at which they met: 0.06 at 30 degrees (0.003 to 0.037 measured, "
        "by where within a substep they meet)",
        "impulses are bounded by what a body between others may get, cos(a)^2 of what stops these: sin(a)^2 of the approach "
        "is left after a substep, and as much of the speed at which contacts push that overlap out; "
        "model/shape_matching/rigid_rebound.py, tests/shape_matching/test_no_rebound.py",
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
        "measured; model/tetrahedra/damping_load.py",
    ),
    Remark(
        "tetrahedra, xpbd with few substeps",
        "some may turn inside out on an impact; a run counts those that are so at its end, and exits with 1",
        "app/outcome.py; docs/method/cases.md, A10: bodies that are turned inside out find their shape again",
    ),
    Remark(
        "tetrahedra, xpbd on colliders",
        "colliders push after an iteration: with one, the weight shortens the lowest elements by a further g h^2 M/m, m"
        " the mass that lies there, M all of it: 0.15 of an edge for 3 layers of 0.1 m with one substep a frame, 0.01 "
        "with 4. With several, colliders act before each of them, too, and what is left is more than halved by twice as"
        " many, down to the step of Newton's method. Above 0.03, which a run notes, a body rebounds from that, and may "
        "slide or tip over where friction would hold it: a cube of 3 voxels that starts without strain on a slope of "
        "tan a = 0.9 mu = 0.45 goes 967, 78, 43 and 39 mm with 1, 2, 4 and 8 substeps of one iteration (1e5 Pa, no "
        "damping), 49 and 29 mm with one substep of 4 and 8, and stays there but for the first",
        "elements move what lies there by M g h^2/m, and a collider takes that back, as a spring of m/h^2 would; "
        "model/tetrahedra/contact_sag.py, tests/core/test_damping_load.py, tests/tetrahedra/test_colliders_in_iterations.py",
    ),
    Remark(
        "tetrahedra, xpbd on a slope",
        "soft bodies that begin prestressed slide 20 to 22 mm further in a second than Coulomb's law lets a stiff one, at "
        "tan a = 1.1 mu (1e5 Pa, settled at mu = 5), as by Newton's method (21 mm): the shear that friction no longer holds "
        "is given back at once, as 20 mm/s; their speed then grows as Coulomb says",
        "measured with 4 substeps; friction on positions, M. Mueller and others, Detailed rigid body simulation (2020), "
        "eq. 30",
    ),
    Remark(
        "grids and cloths of rows and columns, xpbd",
        "friction acts on velocities alone: what sticks on a slope of the angle a creeps down at g h sin a [m/s]",
        CONTACT,
    ),
    Remark(
        "surfaces that rub, xpbd",
        "what sticks creeps by the slip that the sweeps of friction leave over in a substep: a cube of 3 voxels (1e6 Pa, 20 "
        "substeps of 1/1200 s) on a slope of 20 degrees = 0.9 mu goes 3.9, 0.5 and 0.03 mm/s with 1, 2 and 4 `sweeps`",
        "measured; tests/contact/test_surface_contacts.py; docs/method/tetrahedra.md, tetrahedral bodies that meet",
    ),
    Remark(
        "surfaces that rub",
        "angular momentum: a part of friction's moment is left where `distance` exceeds the height of a triangle",
        MEETING,
    ),
    Remark(
        "fluids: shear",
        "the lattice of particles resists shear by up to 0.41 of the pressure at the default support of 1 / 0.55 rest "
        "distances and 0.033 at 2, the default among bodies: with the former, water stays on oil on which it starts, a cube "
        "of 500 kg/m^3 (6 layers of 2.5 cm) gains 2.2 m/s^2 over 0.1 s and one of 900 stops a tenth of a layer higher; with "
        "the latter, water is under the oil after 3 s, and the first cube gains 3.4 where potential flow leaves 3.8. It "
        "begins as that says, within a tenth; then the packing resists, the more the deeper it lies, and bears cubes of 900 "
        "and 1100 after a layer and 0.3 of one. A run notes more than 0.05, and submerged bodies that the lattice bears",
        "model/fluid/shear.py; tests/fluid/test_fluid_shear.py, tests/world/test_rising.py",
    ),
    Remark(
        "fluids: impacts on colliders",
        "of a drop of 64 or 216 particles at 10 m/s, 10 cm apart, less than 4 % of the speed comes back on the mean with "
        "macklin and divergence-free (of 16 or 36 in a plane up to 10 %), and it loses energy. Few iterations of averaged "
        "make a soft medium, which springs back: up to 18 % (24 %) where u h / (d sqrt(iterations)) exceeds 0.09, which a "
        "run notes and advise leaves out, less than 6 % below. What begins nearer to a collider than half a rest distance is "
        "pushed out within a substep, faster the shorter that is: a drop that began 0.47 rest distances too near had 1.5 "
        "times its energy with 16 x 10",
        "measured; tests/public/test_splishsplash_103.py",
    ),
    Remark(
        "fluids: impacts on bodies",
        "a particle is held by the samples of a body where it moves by at most half a rest distance in a substep, and comes "
        "back from it at less than 5 % of its speed; faster ones enter the body, which throws them out on some side",
        "measured with 1 to 16 substeps at 10 m/s; tests/public/test_splishsplash_103.py",
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
        "position-based solvers in float32",
        "a flight's speed and a turn's spin change by the factor 1 + d a substep, |d| <= 1.2e-7, and kinetic energy by "
        "1 + 2 d: d = 5e-8 at h = 1/60 s and its fourths (a rigid body at 0.01 rad/s gained 2.1e-4 of its energy in 2400 "
        "substeps, in float64 none)",
        "h and 1/h are each rounded, by 2^-24 at most: v = (x + h v - x) (1/h)",
    ),
    Remark(
        "other processors",
        "states of `exact` math are the same to the bit; drawn skins, stresses and the step-size limit may "
        "differ by rounding",
        "the order of operations of NumPy's products and eigenvalues is the processor's; tests/machines",
    ),
)  # fmt: skip
