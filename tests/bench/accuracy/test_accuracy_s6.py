"""S6, a stiff rope with a heavy end: its references, the closed form of its rest, its cases beside those of other scenes."""

import math

import numpy as np
import pytest

from softlab.app.command.scene_file import write_scene
from softlab.bench.experiments.accuracy import cases as accuracy_cases
from softlab.bench.experiments.accuracy import methods
from softlab.bench.experiments.accuracy import points as accuracy_points
from softlab.bench.experiments.accuracy.cases import cases, make_case
from softlab.bench.experiments.accuracy.experiment import run_accuracy
from softlab.bench.experiments.accuracy.judge import distance
from softlab.bench.experiments.accuracy.references import LEFT, converged_for, growth_for, motion_of
from softlab.bench.experiments.growth import measure_growth
from softlab.bench.reference import cloth, implicit, mass_spring, rope, steps
from softlab.bench.store.database import Store
from softlab.model.base.errors import SceneError
from softlab.model.core.energy import energies
from softlab.model.core.integrators import IMPLICIT, INTEGRATORS
from softlab.model.scene.scene import Scene, load_scene
from softlab.plots.core.accuracy_points import points
from softlab.plots.core.read import load
from softlab.plots.figures import work_precision

GAUSS_SEIDEL, JACOBI, AVERAGED = methods.XPBD
G = 9.81
STEPS, STILL_STEPS = (0.0025, 0.00125, 0.000625), (0.01, 0.005, 0.0025)  # s; a quick run takes every second


def short(links: int = 8, name: str = "rope-stiff", **changes: float) -> Scene:
    """S6, or S6 at rest, with so few links; keywords replace fields, `__` for the dot."""
    tables = load_scene(name).as_dict()
    tables["cloth"]["columns"] = links + 1
    tables["end"]["at"] = [0, links]
    return Scene(tables).replace({path.replace("__", "."): value for path, value in changes.items()})


# ---------------------------------------------------------------------- references know what a mass weighs


@pytest.mark.parametrize(("integrator", "error"), [("rk4", 1e-9), ("implicit-euler", None)])
def test_a_load_on_a_spring(integrator, error):
    """One mass M on a spring: rk4 is off by (w h)^4 / 120 a radian, 1e-10 m here; implicit Euler decays by
    1/sqrt(1 + w^2 h^2) and turns by atan(w h) a step, exactly, with the w of the load, not of the sheet."""
    scene = short(1, end__mass=0.04, structural__stiffness=10.0, gravity__enabled=False, method__dt=0.001)
    w, h, count = math.sqrt(10 / 0.04), 0.001, 500
    begin, at_rest = mass_spring.start(scene)
    begin[1, 0] += 0.02
    position, _ = mass_spring.simulate(scene, count, begin, at_rest, integrator=integrator)
    x = position[1, 0] - scene.grid.spacing
    if error:
        assert x == pytest.approx(0.02 * math.cos(w * h * count), abs=error)
    else:
        decay, angle = 1 / math.sqrt(1 + (w * h) ** 2), math.atan(w * h)
        assert x == pytest.approx(0.02 * decay**count * math.cos(count * angle), abs=1e-12)


@pytest.mark.parametrize("integrator", ["rk4", "velocity-verlet", "implicit-euler"])
def test_a_load_falls_as_all_masses_do(integrator):
    """Unpinned, without a damper: g a step of h for every mass, whatever it weighs, and no strain. With a damper a load keeps
    1 - c h / M of its speed where the others keep 1 - c h / m: it falls ahead, but for the stiff links."""
    scene = short(4, cloth__pinned="none", structural__stiffness=1e3, method__dt=0.002)
    position, velocity = mass_spring.simulate(scene, 50, integrator=integrator)
    assert velocity[:, 1] == pytest.approx(-G * 0.1, abs=1e-12)
    assert np.abs(np.diff(position[:, 0]) - scene.grid.spacing).max() < 1e-12
    braked = scene.replace({"damping.coefficient": 0.02, "structural.stiffness": 1e-9})
    _, velocity = mass_spring.simulate(braked, 50, integrator=integrator)
    rates = 0.02 / np.array([0.01] * 4 + [1.0])
    assert velocity[:, 1] == pytest.approx(-G / rates * (1 - np.exp(-0.1 * rates)), rel=0.002)  # h c / 2 m


def test_a_reference_keeps_the_energy_of_a_loaded_rope():
    """Undamped: what RK4 loses falls with the fifth power of the step; the load's share of the energy is most of it."""
    scene = short()

    def lost(count: int) -> float:
        state = mass_spring.simulate(scene.replace({"method.dt": 0.1 / count}), count, integrator="rk4")
        return abs(energies(scene, *state)["total"] - energies(scene, *mass_spring.start(scene))["total"])

    coarse, fine = lost(1000), lost(2000)
    assert fine < 1e-9 * G * 0.05  # of the load's fall
    assert coarse > 8 * fine


def test_implicit_euler_of_a_loaded_rope():
    """Its step solves its own equation to rounding, and its error to RK4 halves with the step."""
    scene = short(structural__stiffness=1e4)
    right, _, estimate = mass_spring.converged(scene, 0.2, per_radian=0.5, tolerance=1e-6)
    errors = []
    for count in (200, 400, 800):
        found, _ = implicit.simulate(scene.replace({"method.dt": 0.2 / count}), count, linear=False)
        errors.append(np.abs(found - right).max())
    assert estimate < 1e-6 * scene.grid.spacing
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(2, rel=0.1)
    begin, at_rest = (a.reshape(1, 9, 3) for a in mass_spring.start(scene))
    p, v = implicit.simulate(scene, 1, linear=False)
    p, v = p.reshape(1, 9, 3), v.reshape(1, 9, 3)
    momentum = (steps.masses(scene) * (v - at_rest))[:, 1:]
    force = scene.method.dt * cloth.forces(scene, p, v, 0.0, 0)[:, 1:]
    assert np.abs(momentum - force).max() < 1e-9 * scene.method.dt * G
    assert np.abs(p - begin - scene.method.dt * v).max() < 1e-15


@pytest.mark.parametrize("name", [GAUSS_SEIDEL, JACOBI])
def test_converged_xpbd_is_implicit_euler(name):
    """docs/method/cases.md, A9: but for the turning of directions within a step, 2.3e-5 m in 18 steps; of this rope, too."""
    scene = short().replace(methods.changes(name, 4000) | {"method.dt": 1 / 480})
    with make_case("S6", scene, "cpu", "float64", "exact").open() as simulation:
        simulation.advance(18)
        mine = simulation.state().position
    newton, _ = implicit.simulate(scene, 18, linear=False)
    begin, _ = mass_spring.start(scene)
    assert np.abs(newton - begin).max() > 1e-3
    assert np.abs(mine - newton).max() < 2.3e-5


# ---------------------------------------------------------------------- at rest


def test_the_closed_form_is_at_rest():
    """The forces at it are those of the pin alone, which carries all other masses; without gravity it is not stretched."""
    scene = short(name="rope-stiff-still")
    still = rope.hanging(scene)
    force = cloth.forces(scene, still.reshape(1, 9, 3), np.zeros((1, 9, 3)), 0.0, 0)[0]
    weight = G * (7 * 0.01 + 1.0)
    assert np.abs(force[1:]).max() < 1e-8  # N: 1e6 N/m at coordinates of 0.4 m
    assert force[0] == pytest.approx([0.0, -weight - G * 0.01, 0.0], abs=1e-8)
    below = 1.0 + 0.01 * np.arange(8)
    assert -still[-1, 1] - 8 * 0.05 == pytest.approx(below.sum() * G / 1e6, abs=1e-14)
    assert rope.hanging(scene.replace({"gravity.enabled": False}))[:, 1] == pytest.approx(-0.05 * np.arange(9))


@pytest.mark.parametrize(
    "changes", [{"cloth.rows": 2}, {"cloth.pinned": "none"}, {"bending.stiffness": 1.0}, {"wind.drag": 1.0}]
)
def test_what_does_not_hang_so_is_refused(changes):
    with pytest.raises(SceneError, match="first mass pinned"):
        rope.hanging(short(name="rope-stiff-still").replace(changes))


def test_a_rope_at_rest_is_too_long_by_h_squared():
    """A9: with one sweep a substep the end hangs lower than the closed form by what falls with the square of the step; of
    four it is the less. The swing has gone by then: the whole error is along the rope."""
    scene, end = load_scene("rope-stiff-still"), accuracy_points.end_of("S6-still")
    still, free = rope.hanging(scene), np.arange(65) > 0
    too_low = {}
    for iterations, dt in ((1, 0.000625), (1, 0.00015625), (4, 0.00015625)):
        solved = scene.replace(methods.changes(GAUSS_SEIDEL, iterations) | {"method.dt": dt})
        with make_case("S6-still", solved, "cpu", "float64", "exact").open() as simulation:
            simulation.advance(round(end / dt))
            position = simulation.state().position
        too_low[iterations, dt] = still[-1, 1] - position[-1, 1]
        assert np.abs(position[:, [0, 2]]).max() < LEFT
        largest = distance(position, still, free, 1.0)[1]
        assert largest == pytest.approx(too_low[iterations, dt], rel=1e-6)
    assert too_low[1, 0.000625] / too_low[1, 0.00015625] == pytest.approx(16, rel=0.02)
    assert 0 < too_low[4, 0.00015625] < too_low[1, 0.00015625] / 4


# ---------------------------------------------------------------------- references of the cases


def test_references_of_a_loaded_rope(tmp_path):
    """Kept in the folder; resolved far beyond what is judged; the same as from twice the steps. The scene is its own motion,
    since mass-spring knows no loads. A disturbance does not grow, whether RK4's twins tell it or implicit Euler's."""
    scene = short()
    assert motion_of(scene) is scene
    made = converged_for("S6", scene, 0.1, tmp_path)
    assert made.estimate < 1e-6 * scene.grid.spacing
    again = converged_for("S6", scene, 0.1, tmp_path)
    assert np.array_equal(again.position, made.position) and len(list(tmp_path.iterdir())) == 1
    finer, _, _ = mass_spring.converged(scene, 0.1, per_radian=1, tolerance=1e-9)
    assert np.abs(finer - made.position).max() < 2 * made.estimate + 1e-12
    growth = growth_for("S6", scene, 0.1, tmp_path)
    assert growth.factor < 20 and not growth.chaotic  # of eight links swing by as few: more than of 64
    assert growth_for("S6", scene.replace({"method.dt": 0.001}), 0.1, tmp_path).factor == growth.factor
    damped = measure_growth(short(name="rope-stiff-still"), 2.0, "implicit-euler", 0.002)
    assert damped.factor < 0.5


def test_methods_that_a_sheet_takes():
    """Implicit Euler steps cloths, not grids; a load takes xpbd. At step sizes of their own."""
    wide = cases(["S1", "S4", "S6", "S6-still"], ["cpu"], True)
    names = {label: {c.scene.method.name for c in wide if c.label == label} for label in ("S1", "S4", "S6", "S6-still")}
    assert names["S1"] == {*INTEGRATORS, *methods.XPBD}
    assert names["S4"] == {*INTEGRATORS, *IMPLICIT, *methods.XPBD}
    assert names["S6"] == names["S6-still"] == set(methods.XPBD)
    sizes = {label: {c.scene.method.dt for c in wide if c.label == label} for label in ("S6", "S6-still")}
    assert sizes == {label: set(found) for label, found in accuracy_cases.ROPE_STEP_SIZES.items()}
    implicit_sizes = {c.scene.method.dt for c in wide if c.scene.method.name in IMPLICIT}
    assert implicit_sizes == set(accuracy_cases.IMPLICIT_STEP_SIZES)
    assert all(c.steps * c.scene.method.dt == pytest.approx(accuracy_points.end_of(c.label)) for c in wide)
    assert len({str(c.description) for c in wide}) == len(wide)
    wrong = {c.precision for c in wide if c.scene.method.name == AVERAGED and c.label != "S1"}
    assert wrong == {"float64"}
    spared = [c for c in wide if (c.label, c.scene.method.iterations, c.scene.method.dt) in accuracy_cases.SPARED]
    assert not [c for c in spared if c.scene.method.position_based]
    assert cases(["S1", "S6"], ["cpu"], True, ["implicit-euler"]) == []
    with pytest.raises(SceneError, match=r"end\.kind"):
        load_scene("rope-stiff").replace(methods.changes("implicit-euler"))


# ---------------------------------------------------------------------- into the store and the figure


@pytest.fixture(scope="module")
def small_run(tmp_path_factory):
    """S4 at 6 x 6 with rk4 and implicit Euler (Newton's), S6 and S6 at rest with 8 links, in float64, Gauss-Seidel."""
    folder = tmp_path_factory.mktemp("s6")
    scenes = {
        "S4": load_scene("cloth-wind").replace({"cloth.rows": 6, "cloth.columns": 6}),
        "S6": short(),
        "S6-still": short(name="rope-stiff-still", damping__coefficient=1.5),  # at rest as soon as 64 links are
    }
    with pytest.MonkeyPatch.context() as patch:
        for label, scene in scenes.items():
            patch.setitem(accuracy_points.CLOTHS, label, str(write_scene(folder / f"{label}.toml", scene)))
        patch.setitem(accuracy_points.CLOTH_ENDS, "S4", 0.24)
        patch.setitem(accuracy_points.CLOTH_ENDS, "S6", 0.25)
        patch.setattr(accuracy_cases, "CLOTH_STEP_SIZES", (0.004,))
        patch.setattr(accuracy_cases, "IMPLICIT_STEP_SIZES", (0.008, 0.004))
        patch.setattr(accuracy_cases, "ROPE_STEP_SIZES", {"S6": STEPS, "S6-still": STILL_STEPS})
        patch.setattr(
            "softlab.plots.core.accuracy_points.CLOTH_SCENES",
            {label: scene.as_dict() for label, scene in scenes.items()},
        )
        how = {"precisions": ["float64"], "backends": ["cpu"], "progress": False, "quick": True}
        with Store(folder / "results.sqlite") as store:
            run_accuracy(store, integrators=["rk4", "implicit-euler"], scenes=["S4"], **how)
            summary = run_accuracy(store, integrators=[GAUSS_SEIDEL], scenes=["S6", "S6-still"], **how)
            return summary, points(load(store).featured[0]), work_precision.draw(load(store))


def test_errors_of_the_rope(small_run):
    """At rest: h^2 with one iteration, and the solver's error is the whole of it, since the converged scheme hangs at the
    closed form. Swinging: with many iterations first order, and hardly any of it the solver's."""
    summary, _, _ = small_run
    at = {(p.scene, p.dt, p.iterations): p for p in summary.points}
    assert len(at) == 12 and all(p.resolved and not p.diverged and p.growth < 1e3 for p in at.values())
    still = [at["S6-still", dt, 1] for dt in STILL_STEPS[::2]]
    assert still[0].error / still[1].error == pytest.approx(16, rel=0.1)
    assert all(p.solver == p.error for p in still)
    swinging = [at["S6", dt, 20] for dt in STEPS[::2]]
    assert 3 < swinging[0].error / swinging[1].error < 8
    assert swinging[1].solver < at["S6", 0.000625, 1].solver / 10
    assert "S6-still (" in str(summary) and ") at 12 s: 6 runs" in str(summary)


def test_implicit_euler_among_the_points(small_run):
    """The error that NumPy's implicit Euler has, to what Newton's method leaves over (1e-8 of a residual); it falls with the
    step, by less than half with half of it as long as vibrations that it brakes are left in the reference."""
    _, drawn, _ = small_run
    at = {(p.integrator, p.dt): p.error for p in drawn if p.scene == "S4"}
    assert set(at) == {("rk4", 0.004), ("implicit-euler", 0.008), ("implicit-euler", 0.004)}
    assert 1 < at["implicit-euler", 0.008] / at["implicit-euler", 0.004] < 2
    assert at["rk4", 0.004] < at["implicit-euler", 0.004]
    scene = load_scene("cloth-wind").replace({"cloth.rows": 6, "cloth.columns": 6, "method.dt": 0.008})
    right = converged_for("S4", motion_of(scene), 0.24, None).position
    position, _ = implicit.simulate(scene, 30, linear=False)
    free = ~steps.pinned_mask(scene).ravel()
    error = distance(position, right, free, scene.grid.spacing)[0]
    assert at["implicit-euler", 0.008] == pytest.approx(error, rel=1e-5)


def test_the_figure_shows_them(small_run):
    """A panel a scene and precision, and a word for every method in the legend."""
    *_, drawing = small_run
    titles = [ax.get_title() for ax in drawing.figure.axes]
    assert titles == ["S4, float64", "S6, float64", "S6-still, float64"]
    (legend,) = drawing.figure.legends
    words = {text.get_text() for text in legend.get_texts()}
    assert words >= {"rk4", "implicit-euler", GAUSS_SEIDEL, "Pareto front"}
