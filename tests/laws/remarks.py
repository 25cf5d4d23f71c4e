"""Measured or derived limits of solvers that are no law of the matrix, each with the test or page that describes it: a
section of docs/limits.md."""

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
        "spin decays as omega(t) = omega0 / sqrt(1 + 2 omega0^2 h t) [1/s], h the substep [s]. That is twice the loss of a "
        "rigid body, whose velocities come from its momenta",
        "tan(D') = sin D / (2 - cos D) of the angles D, D' of two substeps; docs/method/cases.md, A8",
    ),
    Remark(
        "rigid bodies in contact",
        "with restitution 0, bodies that meet face to face stay together. Bodies whose particles interlock, so that contact "
        "normals are inclined by an angle a to the approach, separate at up to sin(a)^4 of the speed of approach: 0.06 at 30 "
        "degrees (measured: 0.003 to 0.037, depending on the moment within the substep)",
        "an impulse is limited to what a body between two others may receive, cos(a)^2 of what stops these. So sin(a)^2 of "
        "the approach is left after a substep, and contacts remove that overlap at sin(a)^2 of its speed; "
        "model/shape_matching/rigid_rebound.py, tests/shape_matching/test_no_rebound.py",
    ),
    Remark(
        "bodies of particles with friction",
        "a step within an impact may gain up to 2 % of the initial energy (coefficient of friction 2): slip is measured "
        "between the centres of two particles, but friction acts where they touch. After each impact of two or three bodies "
        "the energy was at most the initial one",
        "tests/shape_matching/test_friction_couples.py: 30 impacts",
    ),
    Remark(
        "tetrahedra, newton order 2",
        "a body that turns at w [1/s] loses up to 0.42 w^2 h of its spin per second; with order 1, and with vbd, w^2 h as by "
        "implicit Euler",
        "tests/public/test_newton_208.py; docs/method/tetrahedra.md, second order in time",
    ),
    Remark(
        "tetrahedra, newton and vbd: damping",
        "the damper is a Kelvin-Voigt damper in Green's strain. At a stretch s its modulus is up to s^4 times that at rest, "
        "and 0 for a flat tetrahedron",
        "E = (s^2 - 1)/2, so dE/dt = s^2 d(ln s)/dt; the stress that does work with d(ln s)/dt is s^2 times the one that "
        "does work with dE/dt",
    ),
    Remark(
        "tetrahedra, vbd: friction",
        "friction needs as many sweeps as normal forces. On a slope with tan a = 1.5 mu, where a cube (1e5 Pa) should "
        "slide, it sticks with 4 sweeps in one substep per frame, has half of the right acceleration with 10, and all of it "
        "with 30",
        TETRAHEDRA,
    ),
    Remark(
        "tetrahedra, xpbd neo-hookean with volume = \"voxels\"",
        "with few iterations the force is within 2 % of that of its energy, at strains up to 0.25",
        "measured against the slope of the reported energy; model/formulas/constraints/tetrahedron_hookean.py",
    ),
    Remark(
        "tetrahedra, xpbd with scalar constraints |F - R|",
        "converge to a state some per cent off the step of implicit Euler, because each constraint takes its one direction "
        "from the current iterate; rows = \"blocks\" converges to that step",
        TETRAHEDRA,
    ),
    Remark(
        "tetrahedra, xpbd neo-hookean",
        "a tetrahedron that is squeezed evenly to less than J = 0.16 of its volume collapses to a point",
        "model/formulas/constraints/tetrahedron_hookean.py",
    ),
    Remark(
        "tetrahedra, xpbd: damping",
        "damping that the sweeps do not resolve acts as a load on bodies at rest. Let r = tau h E / (rho e^2) over the "
        "number of iterations, e the mean edge. The lowest tetrahedra of a ball (0.5 m, 3e5 Pa) on a floor keep 0.75, 0.7, "
        "0.6 and 0.4 of their volume at r = 1, 2, 3 and 5; a run prints a note above 5",
        "measured; model/tetrahedra/damping_load.py",
    ),
    Remark(
        "tetrahedra, xpbd with few substeps",
        "an impact may invert tetrahedra; a run counts those that are inverted at its end, and exits with 1",
        "app/outcome.py; docs/method/cases.md, A10: bodies that are turned inside out find their shape again",
    ),
    Remark(
        "tetrahedra, xpbd on colliders",
        "with one iteration, colliders act after it, and the weight shortens the lowest elements by an additional g h^2 M/m "
        "(m: mass in contact, M: whole mass): 0.15 of an edge for 3 layers of 0.1 m with one substep per frame, 0.01 with "
        "4. With several iterations colliders also act before each, and doubling the iterations more than halves the "
        "shortening, down to that of Newton's method. Above 0.03 a run prints a note: a body may rebound from it, slide, or "
        "tip over where friction should hold it. A cube of 3 voxels (1e5 Pa, no damping) that starts without strain on a "
        "slope with tan a = 0.9 mu = 0.45 moves 967, 78, 43 and 39 mm with 1, 2, 4 and 8 substeps of one iteration, and 49 "
        "and 29 mm with one substep of 4 and 8 iterations; in all cases but the first it stays there",
        "elements move the mass in contact by M g h^2/m, and a collider reverts that, as a spring of stiffness m/h^2 would; "
        "model/tetrahedra/contact_sag.py, tests/core/test_damping_load.py, tests/tetrahedra/test_colliders_in_iterations.py",
    ),
    Remark(
        "tetrahedra, xpbd on a slope",
        "a soft body that starts prestressed (1e5 Pa, settled at mu = 5) slides 20 to 22 mm farther in the first second than "
        "Coulomb's law allows a stiff one, at tan a = 1.1 mu; by Newton's method, 21 mm. The shear that friction no longer "
        "supports is released at once, as a speed of 20 mm/s; afterwards the speed grows by Coulomb's law",
        "measured with 4 substeps; friction on positions, M. Mueller and others, Detailed rigid body simulation (2020), "
        "eq. 30",
    ),
    Remark(
        "grids and cloths of rows and columns, xpbd",
        "friction acts on velocities only: what should stick on a slope of angle a creeps down at g h sin a [m/s]",
        CONTACT,
    ),
    Remark(
        "surfaces with friction, xpbd",
        "what should stick creeps, because a limited number of friction sweeps leaves slip in each substep. A cube of 3 "
        "voxels (1e6 Pa, 20 substeps of 1/1200 s) on a slope of 20 degrees (tan a = 0.9 mu) creeps at 3.9, 0.5 and 0.03 "
        "mm/s with 1, 2 and 4 `sweeps`",
        "measured; tests/contact/test_surface_contacts.py; docs/method/tetrahedra.md, tetrahedral bodies that meet",
    ),
    Remark(
        "surfaces with friction",
        "angular momentum is not conserved where `distance` exceeds the height of a triangle: a part of friction's moment is "
        "left over",
        MEETING,
    ),
    Remark(
        "fluids: shear",
        "a lattice of particles resists shear by up to 0.41 of the pressure at the default support (1 / 0.55 rest "
        "distances), and by 0.033 at a support of 2, the default among bodies. At the smaller support water that starts on "
        "oil stays there; a cube of 500 kg/m^3 (6 layers of 2.5 cm) rises with 2.2 m/s^2 over the first 0.1 s, and a cube "
        "of 900 kg/m^3 stops a tenth of a layer higher. At the larger support water is below the oil after 3 s, and the "
        "first cube rises with 3.4 m/s^2, where potential flow gives 3.8. This holds within a tenth at the start; then the "
        "packing resists, more at greater depth, and stops cubes of 900 and 1100 kg/m^3 after one layer and 0.3 of one. A "
        "run prints a note above 0.05, and if the lattice supports submerged bodies",
        "model/fluid/shear.py; tests/fluid/test_fluid_shear.py, tests/world/test_rising.py",
    ),
    Remark(
        "fluids: impacts on colliders",
        "a drop of 64 or 216 particles, 10 cm apart, that hits a collider at 10 m/s loses energy and rebounds on average "
        "with less than 4 % of its speed with macklin and divergence-free (16 or 36 particles in a plane: up to 10 %). With "
        "averaged and few iterations the fluid is a soft medium and springs back: with up to 18 % of its speed (in a plane "
        "24 %) where u h / (d sqrt(iterations)) exceeds 0.09, with less than 6 % below. A run prints a note above 0.09, and "
        "advise leaves such settings out. Particles that start nearer to a collider than half a rest distance are pushed "
        "out within one substep, faster if it is shorter: a drop that started 0.47 rest distances too near had 1.5 times "
        "its energy with 16 substeps of 10 iterations",
        "measured; tests/public/test_splishsplash_103.py",
    ),
    Remark(
        "fluids: impacts on bodies",
        "a particle that moves by at most half a rest distance per substep is stopped by the samples of a body, and rebounds "
        "with less than 5 % of its speed. Faster ones enter the body, which pushes them out on any side",
        "measured with 1 to 16 substeps at 10 m/s; tests/public/test_splishsplash_103.py",
    ),
    Remark(
        "trapped particles",
        "a run does not search for them among more than 200 000 particles, nor inside colliders",
        "model/contact/shortfalls.py, MAX_PARTICLES",
    ),
    Remark(
        "position-based solvers",
        "lose gravity where a unit in the last place of a coordinate exceeds the motion by gravity in a substep, g h^2 [m]; "
        "a run prints a note",
        "x + (v + g h) h rounds to x + v h; model/core/stability/resolution.py",
    ),
    Remark(
        "position-based solvers in float32",
        "in each substep the speed of a flight and the spin of a turn change by the factor 1 + d, |d| <= 1.2e-7, and the "
        "kinetic energy by 1 + 2 d. At h = 1/60 s and at a quarter of it d = 5e-8; a rigid body at 0.01 rad/s gained 2.1e-4 "
        "of its energy in 2400 substeps, and none in float64",
        "h and 1/h are each rounded, by 2^-24 at most: v = (x + h v - x) (1/h)",
    ),
    Remark(
        "other processors",
        "states of `exact` math are the same to the bit; drawn skins, stresses and the step-size limit may differ by "
        "rounding",
        "the order of operations of NumPy's products and eigenvalues depends on the processor; tests/machines",
    ),
)  # fmt: skip
