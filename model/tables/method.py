"""The part `method`: how a scene is solved."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from softlab.model.base.table import NotNegative, Part, Positive

IntegratorName = Literal[
    "lab", "semi-implicit-euler", "velocity-verlet", "rk4", "explicit-euler", "taylor", "implicit-euler",
    "implicit-euler-linear",
]  # fmt: skip
SolverName = Literal["mass-spring", "xpbd", "pbd", "shape-matching", "vbd", "newton", "pbf", "world"]
SchemeName = Literal["macklin", "averaged", "divergence-free"]
RowsName = Literal["scalar", "blocks"]
OrderingName = Literal["gauss-seidel", "jacobi", "averaged-jacobi"]
POSITION_BASED = ("xpbd", "pbd", "shape-matching")
MAX_ROUNDS = 1_000_000  # over all constraints per step: seconds for the smallest sheet; a step cannot be interrupted
Rounds = Annotated[int, Field(ge=1, le=MAX_ROUNDS, strict=True)]
MAX_REGION = 8  # a cluster of 17 x 17: larger ones are sums over a region's edges, not over its masses
SHORTEST, LONGEST = 1e-150, 1e150  # s: the squares of steps must be float64 numbers


class Method(Part):
    """The solver of a scene, and its settings.

    A step of dt has `substeps` of equal length, each with `iterations` over all constraints (`mass-spring` has neither).

    - `mass-spring` adds up forces and integrates them with an `integrator`.
    - `xpbd` and `pbd` move masses until constraints are satisfied, in an `ordering`. With `pbd` each projection removes
      the fraction `pbd_stiffness` of a stretch, whatever the stiffness of the spring: 1 - (1 - pbd_stiffness)^n of it
      after n iterations. So the material depends on iterations, substeps and dt.
    - `shape-matching` moves masses towards goals: each window of the grid, 2 `region` + 1 masses wide and high, is
      matched rigidly by its shape at rest.
    - `xpbd` for tetrahedra has two scalar `rows` per tetrahedron, or `blocks`, which converge to implicit Euler.
    - `vbd` (vertex block descent, for tetrahedra) moves one vertex after another, `iterations` times all of them. A
      `chebyshev` above 0, the factor by which a sweep reduces the slowest error, accelerates it by Chebyshev's weights.
    - `newton` (for tetrahedra) solves implicit Euler to the end, in at most `iterations` Newton steps. With `order` 2 a
      substep has two such stages, and oscillations are hardly damped.
    - `pbf` conserves the density of fluids by a `scheme`. With macklin the pressure of a substep grows over its
      iterations, each with the factor `relaxation`. With averaged, corrections are divided by the number of neighbours
      in the lattice, so that a fluid sinks as a whole. divergence-free (DFSPH) conserves the density by velocities, with
      `iterations` for their divergence and as many for the predicted density.
    - `world` contains parts of several families, each with its own solver, in common substeps and iterations: bodies
      with shape-matching, meshes with xpbd, fluids with pbf, and tetrahedra with the solver `tetrahedra`: xpbd, or vbd in
      a scene without a mesh.

    By default a scene with a fluid has dt = 1/60 s, 4 substeps and 10 iterations. Bodies have so many substeps that none
    sinks into a collider by more than 1 % of its spacing, but at most 100, and at least 20 under xpbd and in a world without
    a fluid.
    """

    solver: SolverName = "mass-spring"
    integrator: IntegratorName = "velocity-verlet"
    dt: Positive = 0.01  # s
    substeps: Rounds = 1
    iterations: Rounds = 1
    ordering: OrderingName = "gauss-seidel"
    pbd_stiffness: Annotated[float, Field(gt=0, le=1, strict=True)] = 1.0
    region: Annotated[int, Field(ge=1, le=MAX_REGION, strict=True)] = 1  # masses to each side
    rows: RowsName = "scalar"
    scheme: SchemeName = "macklin"  # for a fluid
    relaxation: Annotated[float, Field(gt=0, le=1, strict=True)] | None = None  # by default 1 for averaged, else 0.5
    softness: Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)] = 1e-3  # for a fluid's constraint
    tensile_correction: Annotated[float, Field(ge=0, le=1, strict=True)] = 0.0  # keeps a fluid's particles apart
    tensile_distance: Annotated[float, Field(gt=0, lt=1, strict=True)] = 0.2  # of the support, where it is that strong
    chebyshev: Annotated[float, Field(ge=0, lt=1, strict=True)] = 0.0  # for vbd: about 0.9; too large a value diverges
    tetrahedra: Literal["xpbd", "vbd"] = "xpbd"  # their solver in a world
    order: Literal[1, 2] = 1  # of newton, in time
    sleeping_speed: NotNegative = 0.0  # m/s, for xpbd: vertices of tetrahedra that move slower stay in place

    @model_validator(mode="after")
    def _fields_belong_to_the_solver(self) -> Method:
        for name in self.model_fields_set - set(FIELDS_OF_SOLVER[self.solver]):
            owners = [solver for solver, fields in FIELDS_OF_SOLVER.items() if name in fields]
            raise ValueError(f"{name}: belongs to the solver {' or '.join(owners)}, not to {self.solver}")
        if self.substeps * self.iterations > MAX_ROUNDS:
            raise ValueError(
                f"iterations: times {self.substeps} substeps they are more than {MAX_ROUNDS} a step; use fewer"
            )
        if not SHORTEST <= self.dt / self.substeps <= self.dt <= LONGEST:
            raise ValueError(f"dt: must make substeps of {SHORTEST:g} to {LONGEST:g} s; use dt = 0.01, for example")
        if self.scheme == "divergence-free" and self.tensile_correction:
            raise ValueError(
                "tensile_correction: applies to the schemes macklin and averaged; leave it out, or use one of them"
            )
        return self

    @property
    def position_based(self) -> bool:
        """True if the solver moves masses until constraints are satisfied, instead of adding up forces."""
        return self.solver in (*POSITION_BASED, *OF_TETRAHEDRA, OF_FLUIDS, OF_WORLDS)

    @property
    def name(self) -> str:
        """Name that distinguishes methods: the integrator, or the solver with its ordering."""
        return self.label if self.position_based else self.integrator

    @property
    def matches_shapes(self) -> bool:
        """True for the solver shape matching."""
        return self.solver == "shape-matching"

    @property
    def label(self) -> str:
        """Solver and its main option: `mass-spring rk4`, `xpbd jacobi`, `shape-matching`, `newton, order 2`."""
        if self.matches_shapes or self.solver in (*OF_TETRAHEDRA, OF_WORLDS):
            return self.solver + f", order {self.order}" * (self.order > 1)
        if self.solver == OF_FLUIDS:
            return f"{self.solver} {self.scheme}"
        blocks = ", blocks" * (self.rows == "blocks")
        return f"{self.solver} {self.ordering if self.position_based else self.integrator}{blocks}"

    @property
    def relaxation_factor(self) -> float:
        """Relaxation factor of an iteration of `pbf`."""
        if self.relaxation is not None:
            return self.relaxation
        return 1.0 if self.scheme == "averaged" else 0.5

    def _idle_fields(self) -> set[str]:
        if self.solver == OF_FLUIDS and self.relaxation is None:
            return set(type(self).model_fields) - (set(FIELDS_OF_SOLVER[self.solver]) - {"relaxation"})
        used = set(FIELDS_OF_SOLVER[self.solver]) - ({"rows"} if self.rows == "scalar" else set())
        if self.solver == OF_WORLDS:  # the fluid's fields are the defaults unless stated
            fields = type(self).model_fields
            used -= {name for name in ("tetrahedra", *ABOUT_FLUIDS) if getattr(self, name) == fields[name].default}
        used -= {name for name in ("chebyshev", "sleeping_speed") if getattr(self, name) == 0}
        used -= {"order"} if self.order == 1 else set()
        return set(type(self).model_fields) - used


ABOUT_FLUIDS = ("scheme", "relaxation", "softness", "tensile_correction", "tensile_distance")
FIELDS_OF_SOLVER = {
    "mass-spring": ("solver", "integrator", "dt"),
    "xpbd": ("solver", "dt", "substeps", "iterations", "ordering", "rows", "sleeping_speed"),
    "pbd": ("solver", "dt", "substeps", "iterations", "ordering", "pbd_stiffness"),
    "shape-matching": ("solver", "dt", "substeps", "iterations", "region"),
    "vbd": ("solver", "dt", "substeps", "iterations", "chebyshev"),
    "newton": ("solver", "dt", "substeps", "iterations", "order"),
    "world": ("solver", "dt", "substeps", "iterations", "tetrahedra", *ABOUT_FLUIDS),
    "pbf": ("solver", "dt", "substeps", "iterations", *ABOUT_FLUIDS),
}
OF_TETRAHEDRA = ("vbd", "newton")  # solvers for tetrahedral bodies only
OF_FLUIDS: SolverName = "pbf"
OF_WORLDS: SolverName = "world"  # for parts of several families
