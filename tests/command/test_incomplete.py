"""A run whose state is finite but lacks some of its physics is not "ok": contacts or neighbours were lost, tetrahedra are
inside out, particles or vertices are caught in another body. Outcome `incomplete`, exit status 1, unless it is allowed."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from softlab import cli
from softlab.app.command.run import Request, run_scene
from softlab.app.driver import open_simulation
from softlab.app.outcome import fault_lines, fault_words, outcome_of
from softlab.app.output.files import write_state
from softlab.app.window.demo import Demo
from softlab.app.window.demo_report import numbers_text
from softlab.bench.experiments.throughput import Throughput, heap
from softlab.bench.measure.timing import Neighbours, Subject, incomplete
from softlab.bench.store.marks import is_wrong
from softlab.model.base.errors import Diverged
from softlab.model.contact.shortfalls import FAULTS, Elements, can_fall_short, caught_in, inverted
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

BOX = {"kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.2, 0.1, 0.1]}, "edge": 0.1}
LUMP = {"kind": "soft_body", "shape": {"name": "box", "sides": [0.05, 0.05, 0.05]}, "particle_spacing": 0.025}
SOLVERS: dict[str, dict[str, Any]] = {
    "rows": {"solver": "xpbd"}, "blocks": {"solver": "xpbd", "rows": "blocks"}, "vbd": {"solver": "vbd"},
    "newton": {"solver": "newton"},
}  # fmt: skip
TWO_TETRAHEDRA = np.array(
    [[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1]]], float
)


def boxes(method: dict[str, Any], apart: float = 1.0, **parts: Any) -> Scene:
    """Two boxes of tetrahedra, `apart` [m] along z, that may meet."""
    contact = {} if method["solver"] == "newton" else {"contact": {}}  # which knows no contacts
    two = BOX | {"origin": [0.01, 0.02, apart]}
    return Scene({"one": BOX, "two": two, "method": {"dt": 0.01} | method, **contact, **parts}, "two boxes")


def mirrored(scene: Scene) -> State:
    """The start with x turned round: every tetrahedron is inside out."""
    with open_simulation(scene, threads=1) as simulation:
        state = simulation.state()
    return State(
        state.position * np.array([-1, 1, 1], state.position.dtype), state.velocity, state.inverse_mass, 0.0, 0
    )


@pytest.mark.parametrize("name", SOLVERS)
def test_inverted_tetrahedra_are_counted_and_end_a_run_as_incomplete(name: str, tmp_path: Path) -> None:
    scene = boxes(SOLVERS[name])
    start = write_state(tmp_path / "mirrored.npz", mirrored(scene))
    result = run_scene(scene, Request(steps=0, initial=start), progress=False)
    count = len(scene.tetrahedra_set.tetrahedra)
    assert (result.report["inverted"], result.report["outcome"]) == (count, "incomplete")
    assert result.incomplete is not None and result.incomplete.exit_status == 1
    assert f"{count} inverted" in str(result.incomplete) and "--allow-incomplete" in str(result.incomplete)
    assert any("inverted" in note for note in result.notes)
    allowed = run_scene(scene, Request(steps=0, initial=start, allow_incomplete=True), progress=False)
    assert allowed.incomplete is None and allowed.report["outcome"] == "incomplete"  # still told
    sound = run_scene(scene, Request(steps=0), progress=False)
    assert (sound.report["inverted"], sound.report.get("caught", 0), sound.report["outcome"]) == (0, 0, "ok")


@pytest.mark.parametrize("name", [name for name in SOLVERS if name != "newton"])
def test_vertices_inside_another_body_are_caught(name: str) -> None:
    """Of two boxes that lie in each other by half their height, each has vertices in the other; without [contact] bodies may
    overlap, and nothing is said."""
    result = run_scene(boxes(SOLVERS[name], apart=0.05), Request(steps=0), progress=False)
    assert result.report["caught"] > 0 and result.report["outcome"] == "incomplete"
    assert any("vertices lie inside another body" in note for note in result.notes)
    free = boxes(SOLVERS["newton"], apart=0.05)
    report = run_scene(free, Request(steps=0), progress=False).report
    assert "caught" not in report and report["outcome"] == "ok"


@pytest.mark.parametrize(("height", "count"), [(0.0, 8), (1.0, 0)])
def test_members_of_a_world_are_counted_together(height: float, count: int) -> None:
    """A lump of particles in the middle of a box of tetrahedra: all of it is caught."""
    scene = Scene(
        {
            "box": BOX | {"shape": {"name": "box", "sides": [0.4, 0.4, 0.4]}, "edge": 0.2},
            "lump": LUMP | {"origin": [0.0, height, 0.0]}, "contact": {}, "method": {"solver": "world", "dt": 0.01},
        },
        "a lump in a box",
    )  # fmt: skip
    assert scene.is_world
    report = run_scene(scene, Request(steps=0), progress=False).report
    assert (report["caught"] >= count > 0) if count else report["caught"] == 0
    assert report["outcome"] == ("incomplete" if count else "ok") and report["inverted"] == 0
    assert report["contacts_lost"] == 0


def test_neighbours_of_a_fluid_that_are_lost_end_a_run_as_incomplete() -> None:
    """Particles that are all in one place have more neighbours than a list holds."""
    scene = Scene(
        {
            "water": {"kind": "fluid", "dimensions": 2, "size": [0.5, 0.5], "rest_distance": 0.05},
            "method": {"solver": "pbf", "dt": 1e-3, "substeps": 1, "iterations": 1},
        },
        "crowded",
    )
    with open_simulation(scene, threads=1) as simulation:
        state = simulation.state()
        crowd = State(0.01 * state.position, state.velocity, state.inverse_mass, 0.0, 0)
        assert simulation.faults() == {"neighbours_lost": 0} and incomplete(simulation) == []
        subject = Subject(simulation, "crowd", start=crowd, steps=1)
        sample = subject.sample(Neighbours())
        assert simulation.faults()["neighbours_lost"] > 0
    assert sample.suspect and is_wrong(sample.suspect) and "incomplete: " in sample.suspect
    assert "neighbours lost" in sample.suspect


@pytest.mark.parametrize("name", FAULTS)
def test_any_fault_makes_the_outcome_incomplete(name: str) -> None:
    assert outcome_of({name: 3}) == "incomplete" and outcome_of({name: 0}) == "ok"
    assert outcome_of({name: 3}, Diverged(1, 0, 0.1, None)) == "diverged"
    assert len(fault_lines({name: 3})) == 1 and fault_lines({name: 0}) == []
    assert fault_words({name: 3}) == f"3 {name.replace('_', ' ')}" and fault_words({}) == ""


def test_a_tetrahedron_is_inside_out_by_its_volume() -> None:
    """The second has two corners swapped; a flat one counts, too."""
    assert inverted(TWO_TETRAHEDRA) == 1
    assert inverted(np.zeros((1, 4, 3))) == 1


def test_caught_points_are_inside_not_on_a_surface() -> None:
    """Of other bodies one inside, one on a side, one outside; and one that lies inside its own body now: at rest it was 3 m
    away from that corner, or, in another body that meets itself less far, near it."""
    points = np.array([[9.0, 9, 9]] * 4 + [[0.1, 0.1, 0.1], [0.1, 0.1, 0.1], [0.2, 0.2, 0.0], [1, 1, 1]])
    bodies, rest = np.array([0, 0, 0, 0, 0, -1, -1, -1]), np.concatenate([TWO_TETRAHEDRA[0], [[4.0, 0, 0]] * 4])
    for apart, expected in ((np.inf, 1), (2.0, 2), (3.5, 1)):
        elements = Elements(np.arange(4)[None], np.zeros(1, int), rest, np.array([apart]))
        assert caught_in(points, bodies, TWO_TETRAHEDRA[:1], elements) == expected


def test_scenes_of_springs_are_never_asked() -> None:
    """Timing a grid reads no state to look for what it cannot have."""
    assert not can_fall_short(load_scene("lab-grid")) and not can_fall_short(load_scene("cloth-sphere"))
    assert can_fall_short(load_scene("cloth-self")) and can_fall_short(boxes(SOLVERS["newton"]))
    assert incomplete(SimpleNamespace(kernel="a peer")) == []


def test_the_command_line_exits_with_1_unless_it_is_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "boxes.toml"
    scene.write_text(
        '[one]\nkind = "tetrahedral_body"\nshape = { name = "box", sides = [0.2, 0.1, 0.1] }\nedge = 0.1\n'
        '[two]\nkind = "tetrahedral_body"\nshape = { name = "box", sides = [0.2, 0.1, 0.1] }\nedge = 0.1\n'
        'origin = [0.01, 0.02, 0.05]\n[contact]\n[method]\nsolver = "xpbd"\ndt = 0.01\n'
    )
    line = ["softlab", "run", str(scene), "--steps", "0", "--json", "--no-judge"]
    for more, status in ([], 1), (["--allow-incomplete"], 0):
        monkeypatch.setattr(sys, "argv", line + more)
        with pytest.raises(SystemExit) as ended:
            cli.main()
        told = capsys.readouterr()
        assert int(ended.value.code or 0) == status, told.err
        assert json.loads(told.out)["outcome"] == "incomplete"
        assert ("softlab: incomplete: " in told.err) == (status == 1)


def test_the_window_tells_of_it() -> None:
    scene = boxes(SOLVERS["rows"])
    state = mirrored(scene)
    with Demo([scene]) as demo:
        assert demo.statistics.faults == "" and "INCOMPLETE" not in numbers_text(demo, 0.02, 0.01)
        demo.world.load(state)
        demo.refresh(force=True)
        assert "inverted" in demo.statistics.faults and demo.message.startswith("incomplete: ")
        assert "INCOMPLETE: " in numbers_text(demo, 0.02, 0.01)


def test_a_rate_of_an_incomplete_state_wins_nothing() -> None:
    """It is in the table with a mark, and in no figure or sentence."""
    scene = heap(50)
    for mark, wrong in ((None, False), ("incomplete: 3 contacts lost", True), ("load: other programs", False)):
        numbers = Throughput().numbers(scene, 1e-3, "fused", mark)
        description = {"scene": json.loads(scene.canonical()), "backend": "cpu", "precision": "float32"}
        kept = [measure_of(name, value, description) for name, value in numbers.items()]
        assert [p.incomplete for p in Throughput().rows(kept, every=True)] == [wrong]
        assert len(Throughput().rows(kept)) == (not wrong)


def measure_of(name: str, value: tuple[Any, str, str | None], description: dict[str, Any]) -> Any:
    return SimpleNamespace(
        name=name, value=value[0], unit=value[1], reason=value[2], description=description, machine="m", backend="cpu",
        configuration="c", sources="s",
    )  # fmt: skip
