"""Text exports that no lab wrote: rows and cells at odds with the tables."""

from __future__ import annotations

from pathlib import Path

import pytest

from softlab.bench.store.database import Store
from softlab.bench.store.transfer import export, merge
from softlab.model.base.errors import InputError

# ---------------------------------------------------------------------- stores


def small(path: Path) -> Store:
    store = Store(path)
    store.add_machine("m", "a machine", {"cores": 2})
    run = store.start_run("m", "softlab")
    store.add_sample(run, {"backend": "cpu"}, "s", 0.5, 100)
    store.add_measure(run, {"backend": "cpu"}, "s", "error", 0.1)
    return store


@pytest.mark.parametrize(("table", "column", "value"), [
    ("machine", "record", 3), ("machine", "record", "[1]"), ("machine", "record", '{"a":' * 3000 + "1" + "}" * 3000),
    ("machine", "label", b"\xff"), ("run", "started", b"2.5"), ("configuration", "description", "[" * 3000),
    ("configuration", "description", "no JSON"), ("sample", "seconds", "long"), ("sample", "repeat", 0.5),
    ("sample", "suspect", b"3"),
    ("measure", "value", "text"), ("measure", "unit", b"m"),
])  # fmt: skip
def test_rows_that_no_lab_wrote(tmp_path: Path, table: str, column: str, value: object) -> None:
    with small(tmp_path / "s.sqlite") as store:
        store.connection.execute(f"UPDATE {table} SET {column} = ?", (value,))
    for opened in (lambda: Store(tmp_path / "s.sqlite", readonly=True), lambda: Store(tmp_path / "s.sqlite")):
        with pytest.raises(InputError, match=rf"s\.sqlite: {table}\.{column} = .* in row 1"):
            opened()
    with Store(tmp_path / "new.sqlite") as target, pytest.raises(InputError, match=f"{table}.{column}"):
        merge(target, tmp_path / "s.sqlite")
    assert not (tmp_path / "new.sqlite").exists()


@pytest.mark.parametrize("cell", ["[" * 3000, "9" * 6000, "9" * 30, '"{""a"":' + "[" * 3000 + '"'])
def test_a_text_export_with_odd_cells(tmp_path: Path, cell: str) -> None:
    with small(tmp_path / "s.sqlite") as store:
        export(store, tmp_path / "s.csv")
    text = (tmp_path / "s.csv").read_text()
    for old in ("step,100,,0,", "cpu", "a machine"):
        assert old in text
        (tmp_path / "odd.csv").write_text(
            text.replace(old, old.replace("0", cell) if "step" in old else f",{cell},", 1)
        )
        with Store(tmp_path / "new?.sqlite") as target, pytest.raises(InputError, match=r"odd\.csv"):
            merge(target, tmp_path / "odd.csv")
        assert not (tmp_path / "new?.sqlite").exists()
