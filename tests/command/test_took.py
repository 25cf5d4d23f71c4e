"""What a measuring command says of its last time, before it starts: a command of the test's own, no measurement."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer

from softlab.app.command.command_line import StorePath
from softlab.bench.measure import took
from softlab.bench.measure.took import Timed, last_duration, store_duration
from softlab.bench.store.database import Store
from softlab.model.base.errors import InputError


@pytest.fixture(autouse=True)
def this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(took, "_machine", lambda: "mine")


def told(path: Path, command: str) -> str:
    return last_duration(path, command)[0]


def measured(path: Path, cases: int, machine: str = "mine") -> None:
    """A run of so many configurations, one of them twice: by a sample and by a measure."""
    with Store(path) as store:
        store.add_machine(machine, "a machine", {})
        run = store.start_run(machine, "softlab test")
        for case in range(cases):
            store.add_sample(run, {"case": case}, "sources", 1.0, 10)
        store.add_measure(run, {"case": 0}, "sources", "error", 0.1)


def test_the_first_time_nothing_is_told_nor_made(tmp_path: Path) -> None:
    path = tmp_path / "store.sqlite"
    assert told(path, "hard") == "" and not path.exists()


def test_seconds_and_configurations_of_the_last_time_are_told(tmp_path: Path) -> None:
    path = tmp_path / "store.sqlite"
    measured(path, 7)
    store_duration(path, "hard", 100.0, 0)
    measured(path, 3)
    store_duration(path, "hard", 41.6, 1)
    assert told(path, "hard") == "took 42 s last time here, for 3 configurations measured"
    assert told(path, "hard quick") == ""


def test_what_measured_nothing_and_another_machine_tell_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "store.sqlite"
    measured(path, 2)
    store_duration(path, "hard", 3.0, 1)
    assert told(path, "hard") == ""
    store_duration(path, "hard", 3.0, 0)
    monkeypatch.setattr(took, "_machine", lambda: "another")
    assert told(path, "hard") == ""


def test_a_store_that_is_none_is_left_to_the_command(tmp_path: Path) -> None:
    path = tmp_path / "store.sqlite"
    path.write_text("no store")
    assert told(path, "hard") == ""
    store_duration(path, "hard", 3.0, 0)
    assert path.read_text() == "no store"


def commands(status: int | None) -> typer.Typer:
    """`work --store FILE [--quick]` measures two configurations and exits with a status, or returns."""
    app = typer.Typer()

    @app.command(cls=Timed)
    def work(store: StorePath, quick: bool = False) -> None:
        measured(store, 2)
        if status is not None:
            raise typer.Exit(status)

    @app.command(cls=Timed)
    def break_down(store: StorePath) -> None:
        measured(store, 2)
        raise InputError("no")

    return app


@pytest.mark.parametrize("status,kept", [(None, True), (1, True), (130, False)])
def test_a_command_says_its_last_time_by_its_options_but_the_store(
    status: int | None, kept: bool, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    app, said = commands(status), []
    for options in ([], ["--quick"], ["--quick"], []):
        arguments = ["work", "--store", str(tmp_path / "store.sqlite"), *options]
        app(arguments, standalone_mode=False)
        said.append(capfd.readouterr().err.strip())
    assert said[:2] == ["", ""]
    assert ["took" in text for text in said[2:]] == [kept, kept]


def test_what_ends_in_an_error_is_not_kept(tmp_path: Path) -> None:
    path = tmp_path / "store.sqlite"
    with pytest.raises(InputError):
        commands(None)(["break-down", "--store", str(path)], standalone_mode=False)
    with Store(path) as store:
        assert not store.query("SELECT 1 FROM sqlite_master WHERE name = 'took'")


def test_every_command_that_measures_says_it() -> None:
    from softlab import cli

    commands = cli.app.registered_commands
    timed = {info.name or info.callback.__name__ for info in commands if issubclass(info.cls or object, Timed)}
    assert timed == {
        "sweep", "accuracy", "stability", "hard", "projections", "throughput", "bar", "advise", "ablate", "busy",
            "tetrahedra", "fluids",
    }  # fmt: skip
