"""The frame of experiments: what is measured of what the store lacks, what Ctrl-C leaves, how samples get into the store."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import pytest

from softlab.bench.measure import experiment
from softlab.bench.measure.experiment import Report, Summary, ending_cleanly, group_name, resume, store_measures
from softlab.bench.measure.items import Finding, Items
from softlab.bench.measure.partition import Alone, use_partition
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures

QUIET: dict[str, Any] = {"progress": False, "command": "test"}


@pytest.fixture
def store(monkeypatch: pytest.MonkeyPatch) -> Any:
    with Store(":memory:") as opened:
        opened.add_machine("m", "Some CPU", {"cpu": "Some CPU", "cores": 2})
        monkeypatch.setattr(experiment, "enter_machine", lambda store: "m")
        yield opened


def description(case: str) -> dict[str, Any]:
    return {"scene": {}, "backend": "cpu", "finding": case}


def measured(
    store: Store, groups: Sequence[Sequence[str]], *, stop: str = "", **how: Any
) -> tuple[Summary, list[list[str]]]:
    """What is done of groups of names, and in which groups; Ctrl-C at the name `stop`."""
    summary, done = Summary.begun(store, "made up"), []

    def held(case: str) -> bool:
        return store.has_measure(description(case), "m", "s", "done")

    def measure(group: Sequence[str], tell: Report) -> None:
        done.append(list(group))
        for case in group:
            if case == stop:
                raise KeyboardInterrupt
            store_measures(store, summary.run, description(case), "s", {"done": (1.0, "", None)})
            summary.measured += 1
            tell(case, 1)

    return resume(store, summary, groups, held, measure, **QUIET, **how), done


def test_what_the_store_holds_is_not_measured_again(store: Store) -> None:
    first, done = measured(store, [["a", "b"], ["c"]])
    assert done == [["a", "b"], ["c"]] and (first.measured, first.stored) == (3, 0) and first.run
    again, done = measured(store, [["a", "b"], ["c"]])
    assert done == [] and (again.measured, again.stored, again.run) == (0, 3, "")
    more, done = measured(store, [["a", "d"], ["c", "e"]])
    assert done == [["d"], ["e"]] and (more.measured, more.stored) == (2, 2)
    assert str(more).startswith("made up: 2 measured, 2 already in the store, ")


def test_of_a_whole_group_all_is_measured_where_anything_lacks(store: Store) -> None:
    measured(store, [["a", "c"]])
    summary, done = measured(store, [["a", "b"], ["c"]], whole=True)
    assert done == [["a", "b"]] and (summary.measured, summary.stored) == (2, 1)


def test_of_several_workers_one_measures_what_it_takes_and_others_have_not_measured(store: Store) -> None:
    """`b` is done by another, between the plan and the turn; the group of `c` is another's."""
    planned: dict[str, tuple[float, str]] = {}

    class Other(Alone):
        def planned(self, store: Store, machine: str, groups: Mapping[str, tuple[float, str]]) -> None:
            planned.update(groups)

        @contextmanager
        def take(self, name: str) -> Iterator[bool]:
            run = store.start_run("m", "another's")
            store_measures(store, run, description("b"), "s", {"done": (1.0, "", None)})
            yield not name.startswith("1-")

    with use_partition(Other()):
        summary, done = measured(store, [["a", "b"], ["c"]])
    assert done == [["a"]] and summary.measured == 1
    assert list(planned.values()) == [(2, "a"), (1, "c")]
    assert len({group_name(0, ["a", "b"]), group_name(1, ["a", "b"]), group_name(0, ["a", "c"])}) == 3
    with use_partition(Other()):
        _, done = measured(store, [["d"], ["c"], ["a"]])
    assert done == [["d"]]


def test_ctrl_c_keeps_what_was_had_and_the_same_command_resumes(store: Store) -> None:
    stopped, done = measured(store, [["a", "b"], ["c"]], stop="b")
    assert stopped.interrupted and stopped.measured == 1 and done == [["a", "b"]]
    assert str(stopped).endswith("; interrupted: the same command resumes")
    rest, done = measured(store, [["a", "b"], ["c"]])
    assert done == [["b"], ["c"]] and (rest.measured, rest.stored, rest.interrupted) == (2, 1, False)


def test_what_breaks_is_not_hidden_and_ctrl_c_within_ctrl_c_is_one(store: Store) -> None:
    summary = Summary("m")
    with pytest.raises(ZeroDivisionError), ending_cleanly(summary):
        raise ZeroDivisionError
    assert not summary.interrupted
    with ending_cleanly(summary), ending_cleanly(summary):
        raise KeyboardInterrupt
    assert summary.interrupted and summary.seconds > 0


def test_items_are_one_experiment(store: Store) -> None:
    class Single(Items):
        name = command = "single"

        def items(self, store: Store, backends: Sequence[str], quick: bool, **_: Any) -> list[Finding]:
            names = ("a",) if quick else ("a", "b")
            return [
                Finding("value", description(f"{name} {b}"), "s", lambda: {"value": (2.0, "m", None)})
                for name in names
                for b in backends
            ]

    run = Single()
    with pytest.raises(TypeError, match="has no options kinds"):
        run(store, kinds=["a"])
    assert run(store, quick=True, backends=["cpu"], progress=False).measured == 1
    whole = run(store, backends=["cpu"], progress=False)
    assert (whole.measured, whole.stored) == (1, 1)
    assert {(m.description["finding"], m.value, m.unit) for m in measures(store)} == {
        ("a cpu", 2.0, "m"),
        ("b cpu", 2.0, "m"),
    }
    assert store.query("SELECT DISTINCT command FROM run") == [("softlab single",)]
