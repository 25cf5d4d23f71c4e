"""Figures and sentences of fluids, from a store that is made up: what they show is what it holds."""

from __future__ import annotations

import pytest
from read_figures import LABELS, labels
from synthetic_store import GPU_RECORD, Maker

from softlab.bench.experiments import fluid_rest
from softlab.bench.experiments.fluid_truth import laws
from softlab.bench.experiments.fluid_truth.experiment import PEERS, Run
from softlab.bench.experiments.fluid_truth.laws import start_off
from softlab.bench.experiments.fluid_truth.scenes import (
    COLUMN,
    DAM,
    DAM_EFFORTS,
    DROP,
    EFFORTS,
    SCHEMES,
    TANK,
    VORTICES,
    Setting,
    settings,
)
from softlab.bench.experiments.fluids import (
    FRAME,
    PHASES,
    Fluids,
    moved_bytes,
    operations,
    phase_name,
    pool,
)
from softlab.bench.measure.case_timing import make_case
from softlab.bench.measure.costs_timing import SECONDS
from softlab.bench.peers.fluids.beside import peer_of
from softlab.bench.store.database import Store
from softlab.labbook.claims.fluids import CLAIMS
from softlab.model.fluid.plan import neighbours_at_rest
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.core.style import settings as drawing_settings
from softlab.plots.figures.fluids import phases, rest, truth

TAKEN = 1e-9  # s a particle of the first stage, twice that of the second ...


def numbers_of(one: Setting) -> dict[str, float]:
    """macklin is off by a tenth over the effort, averaged ten times as far."""
    method = one.scene.method
    worse = 1.0 if method.scheme == "macklin" else 10.0
    off = worse * 0.1 / (method.substeps * method.iterations)
    spacing = one.scene.fluid_set.spacing
    if one.kind in (COLUMN, TANK):
        names = (laws.MEAN, laws.LARGEST, laws.SPEED, laws.PRESSURE)
        return dict.fromkeys(names, off) | {laws.HEIGHT: -off}
    if one.kind == DAM:
        return {laws.FRONT: 0.05 + off, laws.FRONT_LATER: off, laws.FRONT_MEAN: off}
    if one.kind == VORTICES:
        return {laws.VISCOSITY: worse * spacing**2}
    return {laws.INSIDE: 50.0, laws.ASPECT: 1.01} if one.kind == DROP else {}


def still_numbers(one: Setting, seconds: float, peer: bool) -> dict[str, float]:
    """Speeds of a hundredth, of `divergence-free` in one substep a tenth; energies that fall by the time."""
    method = one.scene.method
    boils = (method.scheme, method.substeps) == ("divergence-free", 1)
    times = [time for time in fluid_rest.TIMES if time <= seconds]
    speeds = {f"{fluid_rest.SPEED}{time:g}": 0.1 if boils else 0.005 if peer else 0.01 for time in times}
    return speeds | {f"{fluid_rest.ENERGY}{time:g}": -1e-3 * time for time in times}


@pytest.fixture(scope="module")
def results() -> Results:
    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "c")
    for one in settings():
        method = one.scene.method
        peers = (
            [peer_of(method) for method in PEERS.get(one.kind, ())]
            if one.beside and method.scheme == SCHEMES[0]
            else []
        )
        ways = [(None, 1.0), *((peer, 2.0) for peer in peers)]
        for peer, slower in ways:
            told = Run(one, "cpu", peer).description
            frame = slower * 1e-3 * method.substeps * method.iterations
            numbers = {**numbers_of(one), SECONDS: frame * method.dt / FRAME}
            for name, value in numbers.items():
                store.add_measure(maker.run, told, "s", name, value, "", "of 9 pairs")
    for one, seconds in fluid_rest.settings(quick=False):
        for peer in (None, peer_of("DFSPH")) if one.beside else (None,):
            for name, value in still_numbers(one, seconds, peer is not None).items():
                told = Run(one, "cpu", peer, threads=1).description
                store.add_measure(maker.run, told, "s", name, value, "", "2.19.0" if peer else None)
    scene = pool(1000)
    for backend in ("cpu", "gpu"):
        case = make_case(scene, backend, "float32", "1000 particles")
        step = 1e-3
        for name, value in ((Fluids.step, step), (Fluids.rate, Fluids().work(scene) / step)):
            store.add_measure(maker.run, case.description, "s", name, value, "s", None)
        for number, phase in enumerate(PHASES, 1):
            store.add_measure(maker.run, case.description, "s", phase_name(phase), number * TAKEN * 1000, "s", "alone")
    return load(store)


def test_errors_stand_over_their_times(results: Results) -> None:
    with drawing_settings():
        drawing = truth.draw(results)
    assert not isinstance(drawing, str) and labels(drawing.figure) == LABELS["fluids-truth"]
    tank, dam, vortices = drawing.figure.axes
    mine = [line for line in tank.lines if line.get_color() == truth.COLOURS["macklin"][0]]
    curve = max(mine, key=lambda line: len(line.get_xdata()))
    assert curve.get_xdata() == pytest.approx(sorted(a * b for a, b in EFFORTS))
    assert curve.get_ydata() == pytest.approx([0.1 / n for n in sorted(a * b for a, b in EFFORTS)])
    stars = [line for line in tank.lines if line.get_marker() == truth.PEERS[0] and len(line.get_xdata())]
    assert stars[0].get_xdata()[0] == pytest.approx(2 * EFFORTS[1][0] * EFFORTS[1][1])
    a, b = DAM_EFFORTS[-1]
    some = [line.get_ydata()[0] for line in dam.lines if line.get_color() == truth.COLOURS["macklin"][0]]
    assert sorted(some) == pytest.approx([0.1 / (a * b), 0.05 + 0.1 / (a * b)])
    fine = next(line for line in vortices.lines if line.get_color() == truth.COLOURS["averaged"][0])
    assert list(fine.get_ydata()) == pytest.approx([10 * x**2 for x in fine.get_xdata()])


def test_stages_stand_beside_their_limits(results: Results) -> None:
    with drawing_settings():
        drawing = phases.draw(results)
    assert not isinstance(drawing, str) and labels(drawing.figure) == LABELS["fluids-phases"]
    (source,) = results.everyone
    scene = pool(1000)
    for ax, backend in zip(drawing.figure.axes, ("cpu", "gpu"), strict=True):
        taken, allowed = ([bar.get_width() for bar in bars] for bars in ax.containers)
        assert taken == pytest.approx([1e9 * TAKEN * n for n in range(1, len(PHASES) + 1)])
        limits = phases.rates(source, backend)
        assert limits is not None
        for phase, least in zip(PHASES, allowed, strict=True):
            moved, done = (
                moved_bytes(phase, neighbours_at_rest(scene)) / limits[0],
                operations(scene, phase) / limits[1],
            )
            assert least == pytest.approx(1e9 * max(moved, done))


def test_speeds_and_energies_stand_over_their_times(results: Results) -> None:
    with drawing_settings():
        drawing = rest.draw(results)
    assert not isinstance(drawing, str) and labels(drawing.figure) == LABELS["fluids-rest"]
    speed, energy, box = (drawing.figure.axes[3 * row + SCHEMES.index("divergence-free")] for row in range(3))
    for ax, height in ((speed, 0.1), (energy, None), (box, 0.1)):
        (one,) = (line for line in ax.lines if line.get_color() == rest.COLOURS[1] and len(line.get_xdata()) > 2)
        assert list(one.get_xdata()) == list(fluid_rest.TIMES)
        assert list(one.get_ydata()) == [-1e-3 * time if height is None else height for time in fluid_rest.TIMES]
    curves = [line for line in speed.lines if len(line.get_xdata()) > 2]
    assert len(curves) == len(fluid_rest.SUBSTEPS) + 1, "a curve each, and the other program's"
    assert [line.get_ydata()[0] for line in curves if line.get_color() == rest.BLACK] == [0.005]


def test_sentences_say_what_was_measured(results: Results) -> None:
    made = {name: claim(results) for name, claim in CLAIMS.items()}
    assert not [name for name, claim in made.items() if not claim.supported]
    column = made["fluids-column"]
    first = next(a * b for a, b in EFFORTS if 0.1 / (a * b) <= 0.01)
    assert column.numbers["macklin frame"] == pytest.approx(1e-3 * first) and "not with any effort" in column.sentence
    assert column.numbers["averaged height"] == pytest.approx(1 - 1 / 6)
    assert made["fluids-fastest"].numbers["frame"] == column.numbers["macklin frame"]
    assert made["fluids-dam"].numbers["front"] == pytest.approx(0.05 + 0.1 / 20)
    assert made["fluids-dam"].numbers["start"] == start_off()
    assert made["fluids-viscosity"].numbers["macklin ratio"] == pytest.approx(16)
    assert made["fluids-drop"].numbers["law"] == pytest.approx(2 / 3)
    assert made["fluids-peers"].numbers["SPlisHSPlasH DFSPH"] == pytest.approx(2)
    assert made["fluids-rate"].numbers["gpu"] == pytest.approx(6e6)
    still = made["fluids-rest"].numbers
    assert (still["macklin still"], still["divergence-free still"]) == (5, 4)
    assert still["macklin"] == 0.01 and still[fluid_rest.PEER] == 0.005
    assert "divergence-free with 2 to 16 substeps" in made["fluids-rest"].sentence


def test_nothing_is_told_of_nothing() -> None:
    nothing = load(None)
    assert all(isinstance(draw(nothing), str) for draw in (truth.draw, phases.draw, rest.draw))
    assert not any(claim(nothing).supported for claim in CLAIMS.values())
