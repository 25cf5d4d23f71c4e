"""The laws that fluids are judged by, on motions that are known; what is measured, and that it is; SPlisHSPlasH beside."""

from __future__ import annotations

import io
from time import sleep
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from softlab.bench.experiments.fluid_truth import experiment, laws, scenes
from softlab.bench.experiments.fluid_truth.experiment import LABELS, groups
from softlab.bench.experiments.fluid_truth.rows import NUMBERS, FluidTruth, Judged, print_truth, rows, tensions
from softlab.bench.experiments.fluid_truth.scenes import (
    COLUMN,
    DAM,
    DROP,
    SCHEMES,
    TANK,
    TENSION,
    TWO,
    VORTICES,
    Setting,
    settings,
)
from softlab.bench.measure.costs_timing import Effort
from softlab.bench.peers.base import Opened, Peer
from softlab.bench.peers.fluids.splishsplash import SplishSplash, scale_of, scene_of
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.core.build import build
from softlab.model.fluid.measure import compression
from softlab.model.particles.fluid_set import vortices
from softlab.model.scene.scene import Scene, load_scene

G = 9.81


class Known:
    """A motion in closed form: `at(time)` gives position, velocity and pressure (or None)."""

    def __init__(self, scene: Scene, at: Any):
        self.scene, self.time, self.at = scene, 0.0, at

    def advance(self, steps: int) -> None:
        self.time += steps * self.scene.method.dt

    def read(self, name: str) -> np.ndarray:
        found = self.at(self.time)[("position", "velocity", "pressure").index(name)]
        if found is None:
            raise ValueError(name)
        return np.asarray(found)


def values(scene: Scene, kind: str, at: Any) -> dict[str, Any]:
    found = laws.judged(Known(scene, at), scene, kind)
    assert set(NUMBERS[kind]) <= set(found)
    return {name: value for name, (value, _, _) in found.items()}


# ---------------------------------------------------------------------- laws


@pytest.mark.parametrize("kind", [COLUMN, TANK])
def test_a_lattice_at_rest_is_off_by_nothing(kind: str) -> None:
    """Kernels are scaled by that lattice (A12): no density exceeds it, whatever its walls."""
    scene = load_scene("column") if kind == COLUMN else scenes.tank()
    place = scene.fluid_set.position
    depth = 1.0 if kind == COLUMN else 0.1
    pressure = 1000 * G * (depth - place[:, 1])
    found = values(scene, kind, lambda time: (place, np.zeros_like(place), pressure))
    assert found[laws.HEIGHT] == pytest.approx(0, abs=1e-12) and found[laws.SPEED] == 0
    assert found[laws.MEAN] < 1e-12 and found[laws.LARGEST] < 1e-12
    assert found[laws.PRESSURE] < 1e-12


def test_a_column_that_has_sunk_is_off_by_as_much() -> None:
    scene = load_scene("column")
    place = scene.fluid_set.position * [1, 0.9, 1]
    found = values(scene, COLUMN, lambda time: (place, np.full_like(place, 0.1), None))
    assert found[laws.HEIGHT] == pytest.approx(-0.1 * 0.975 / 1.0, abs=1e-12)  # half a spacing stays below the lowest
    assert found[laws.PRESSURE] is None and found[laws.SPEED] == pytest.approx(0.1 * np.sqrt(3 / G))
    assert found[laws.MEAN] == pytest.approx(compression(scene, place)[0]) and found[laws.MEAN] > 0.05


def _late(late: float) -> Any:
    """Martin and Moyce's own front, so much later."""
    scene = scenes.dam(10)
    unit = np.sqrt(scenes.WIDTH / (2 * G))

    def at(time: float) -> tuple[np.ndarray, None, None]:
        x = np.interp(time / unit - late, [0, *laws.MOYCE[:, 0]], [1, *laws.MOYCE[:, 1]])
        return np.array([[x * scenes.WIDTH - scene.fluid_set.spacing / 2, 0.0]]), None, None

    return scene, at


def test_the_experiment_itself_is_off_by_its_shift_alone() -> None:
    """A shift of time is found to its step of 1/200 and to what a front moves between two steps of the scene."""
    scene, at = _late(0.2)
    found = values(scene, DAM, at)
    step = scene.method.dt / np.sqrt(scenes.WIDTH / (2 * G))
    assert found[laws.SHIFT] == pytest.approx(-0.2, abs=0.006)
    assert found[laws.FRONT_MEAN] <= found[laws.FRONT] < 0.5 * step  # the steepest front: 1.8 widths a unit, halfway


def test_the_first_point_is_off_the_parabola_of_the_next() -> None:
    """On a parabola from rest by nothing; of the experiment by more than is allowed of a scheme."""
    t = laws.MOYCE[:3, 0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(laws, "MOYCE", np.column_stack([t, 1 + 0.3 * (t + 0.1) ** 2]))
        assert laws.start_off() == pytest.approx(0, abs=1e-12)
    assert 0.05 < laws.start_off() < 0.06


def test_vortices_that_slow_down_have_that_viscosity() -> None:
    scene = load_scene("taylor-green")
    place = scene.fluid_set.position
    wave = vortices(place, scene.domain)  # type: ignore[arg-type]
    found = values(scene, VORTICES, lambda time: (place, wave * np.exp(-8 * np.pi**2 * 0.003 * time), None))
    assert found[laws.VISCOSITY] == pytest.approx(0.003, rel=1e-9)


def test_a_drop_that_moves_and_is_drawn_out() -> None:
    scene = scenes.drop(6)
    start = scene.fluid_set.position
    velocity = np.full_like(start, 0.01)
    found = values(
        scene, DROP, lambda time: ((start + time * velocity) * [1, 1, 2], velocity, np.full(len(start), 7.0))
    )
    assert found[laws.ASPECT] == pytest.approx(2) and found[laws.MOMENTUM] == pytest.approx(1)
    assert found[laws.INSIDE] == pytest.approx(7) and found[laws.DRIFT] > 1


@pytest.mark.parametrize("axes", [2, 3])
def test_the_slope_of_drops_pressures_is_the_surface_tension(axes: int) -> None:
    """Laplace's law with a pressure that is there at any radius; two drops are always on a line, and tell nothing."""
    drops = [
        Judged(
            TENSION, "m", "cpu", "macklin", False, 8, 8, 0.05, 100, axes, radius, 5.0,
            {laws.INSIDE: 40.0 + (axes - 1) * 3.0 / radius}, None, False, None,
        )
        for radius in (0.2, 0.3, 0.5)
    ]  # fmt: skip
    (found,) = tensions(drops)
    assert (found.sigma, found.base_pressure, found.off) == pytest.approx((3.0, 40.0, 0.0)) and found.drops == 3
    assert tensions(drops[:2]) == []


def test_fluids_that_have_changed_places_and_that_have_not() -> None:
    """In the scene they begin side by side: half of each is in the other's half, but for layers at the level."""
    scene = load_scene("two-fluids")
    found = scene.fluid_set
    changed, still = np.empty_like(found.position), np.zeros_like(found.position)
    heavy = found.fluid == int(np.argmax([part.density for part in scene.fluids.values()]))
    order = np.argsort(found.position[:, 1], kind="stable")
    changed[heavy], changed[~heavy] = found.position[order[: heavy.sum()]], found.position[order[heavy.sum() :]]
    done = values(scene, TWO, lambda time: (changed, still, None))
    assert done[laws.LEVEL] == pytest.approx(0, abs=1e-12) and done[laws.MIXED] == 0
    before = values(scene, TWO, lambda time: (found.position, still, None))
    assert before[laws.MIXED] > 0.4 and before[laws.LEVEL] > 0.2


# ---------------------------------------------------------------------- what is measured


def test_every_scheme_is_judged_on_every_kind() -> None:
    every = list(settings())
    for scheme in SCHEMES:
        assert {one.kind for one in every if one.scene.method.scheme == scheme} == set(NUMBERS)
    assert len({one.kind + one.scene.canonical() for one in every}) == len(every)
    assert {one.kind for one in every if one.beside} == {TANK, DAM}
    assert len(list(settings(True))) < len(every) / 3


class Still(Peer):
    """A program in which nothing moves; or none at all."""

    backend = "cpu"

    def __init__(self, name: str, here: bool):
        self.name, self.label, self.here = name, name, here

    def available(self) -> tuple[bool, str]:
        return self.here, "nobody has it"

    def refusal(self, scene: Scene) -> str | None:
        return None

    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        return _Still(scene)


class _Still(Opened):
    def __init__(self, scene: Scene):
        body = build(scene)
        self.load(body.position, body.velocity)

    def advance(self, steps: int) -> None:
        sleep(1e-4 * steps)  # a time to be sampled

    def synchronize(self) -> None:
        pass

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._held = np.asarray(position), np.asarray(velocity)

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        return self._held


def test_it_is_really_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """A narrow dam for a moment, a program that stands still, and one that is not here: its reason is told."""
    narrow = scenes.dam(4).replace({"method.substeps": 1, "method.iterations": 1})
    monkeypatch.setattr(experiment, "settings", lambda quick=False: iter([Setting(DAM, narrow, True)]))
    peers = {"a still one": Still("a still one", True), "another": Still("another", False)}
    monkeypatch.setattr(experiment, "PEERS", {DAM: tuple(peers)})
    monkeypatch.setattr("softlab.bench.peers.fluids.beside.peer_of", peers.get)
    monkeypatch.setattr(experiment, "QUICK", Effort(2, 1e-3, 0.01))
    monkeypatch.setattr(laws, "DAM_SECONDS", 0.01)
    with Store(":memory:") as store:
        for peers, held in ((False, 0), (True, 0), (True, 1)):
            summary = FluidTruth()(store, quick=True, backends=["cpu"], progress=False, peers=peers)
            assert (summary.measured, summary.stored) == (1 - held, held)
        found = {row.who: row for row in rows(measures(store))}
        printed = io.StringIO()
        print_truth(Console(file=printed, width=120), store, summary.machine)
    ours, still, none = found["macklin"], found["a still one"], found["another"]
    assert ours.frame is not None and ours.frame > 0 and 0 < ours.numbers[laws.FRONT] < still.numbers[laws.FRONT]
    assert still.numbers[laws.FRONT] == pytest.approx(1 - 1 / laws.MOYCE[-1, 1])  # it is where the front was
    assert none.frame is None and not none.numbers and "nobody has it" in (none.reason or "")
    assert "nobody has it" in printed.getvalue() and "its own" in printed.getvalue()


def test_a_group_with_peers_is_another_than_without() -> None:
    with Store(":memory:") as store:
        alone, beside = (groups(store, ["cpu"], True, peers) for peers in (False, True))
    assert [g.name for g in alone] == [g.name for g in beside]
    longer = {g.name for g, h in zip(alone, beside, strict=True) if len(h.descriptions) > len(g.descriptions)}
    assert not longer or longer == {"tank, cpu"}  # quick: the dam beside peers is left out
    for group in beside:
        peers = [one["peer"] for one in group.descriptions]
        assert peers == sorted(peers, key=lambda name: name is not None), "the lab first"


# ---------------------------------------------------------------------- SPlisHSPlasH


def test_its_scene_is_the_lab_s_in_its_own_size() -> None:
    scene = scenes.tank()
    larger, told = scale_of(scene), scene_of(scene, 4)
    assert larger * scene.fluid_set.spacing == pytest.approx(2 * told["Configuration"]["particleRadius"])
    (box,) = told["RigidBodies"]
    low = np.array(box["translation"]) - np.array(box["scale"]) / 2
    assert low == pytest.approx(np.full(3, -0.6 * larger * scene.fluid_set.spacing))
    assert told["Fluid"]["Viscosity_Standard"]["viscosity"] == pytest.approx(4e-3 * larger**1.5)


@pytest.mark.parametrize(
    ("scene", "reason"),
    [
        (load_scene("column"), "no domain"),
        (load_scene("two-fluids"), "one fluid"),
        (scenes.drop(6), "cohesion"),
        (load_scene("lab-water"), "no sphere"),
    ],
)
def test_it_refuses_what_it_does_not_know(scene: Scene, reason: str) -> None:
    assert reason in (SplishSplash("DFSPH").refusal(scene) or "")
    assert SplishSplash("DFSPH").refusal(scenes.dam(10)) is None


@pytest.mark.parametrize("method", ["DFSPH", "PBF"])
def test_it_falls_as_everything_does(method: str) -> None:
    """A block above its floor: g t^2 / 2, to what a step of symplectic Euler adds, g t h / 2, h at most 5 ms of its own time;
    and again after `load`."""
    peer = SplishSplash(method)
    assert LABELS[peer.name] == peer.label
    able, reason = peer.available()
    if not able:
        pytest.skip(reason)
    scene = scenes.dam(6).replace({"water.origin": [0.02, 0.05]})
    seconds = 20 * scene.method.dt
    with peer.open(scene, "float32", 1) as opened:
        for _ in range(2):
            start = opened.read()[0].astype(np.float64)
            assert start == pytest.approx(scene.fluid_set.position, abs=1e-7)
            opened.advance(20)
            fallen = (start - opened.read()[0]).mean(axis=0)
            most = G * seconds * 0.005 / np.sqrt(scale_of(scene)) / 2
            assert 0 <= fallen[1] - G * seconds**2 / 2 <= 1.02 * most and abs(fallen[0]) < 1e-3 * fallen[1]
            opened.load(scene.fluid_set.position, np.zeros_like(start))
