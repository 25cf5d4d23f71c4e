"""What is printed stays whole: no cell of a table is cut at any width, and a file gets a sentence a line."""

import io

import pytest
from rich.table import Table

from softlab.app.command.console import Output
from softlab.bench.measure.tables import columns, print_table

WORDS = ("solver", "precision")
NUMBERS = tuple(f"a head of several words {number}" for number in range(9))
ROWS = [
    [f"position-based {row}", "float64", *(f"{row * column * 1.2345e-3:.6g}" for column in range(9))]
    for row in range(1, 4)
]
SENTENCE = "a sentence of many words, " * 8


def printed(width: int, terminal: bool) -> str:
    file = io.StringIO()
    console = Output(file=file, force_terminal=terminal, width=width, color_system=None, highlight=False)
    print_table(console, columns(WORDS, NUMBERS), ROWS, below=SENTENCE, title=SENTENCE)
    console.print(SENTENCE)
    return file.getvalue()


def lines_of(text: str) -> list[list[str]]:
    """Those that hold a row, as their cells."""
    return [line.split() for line in text.splitlines() if line.lstrip().startswith("position-based")]


@pytest.mark.parametrize("width", [44, 60, 80, 240])
def test_a_terminal_however_narrow_gets_every_cell(width: int) -> None:
    text = printed(width, terminal=True)
    found = lines_of(text)
    assert all(len(line.rstrip()) <= width for line in text.splitlines() if "sentence" not in line)
    for name, number, precision, *cells in ([*row[0].split(), *row[1:]] for row in ROWS):
        mine = [line for line in found if line[1] == number]
        assert all(line[:3] == [name, number, precision] for line in mine), "each block tells which row is which"
        assert [cell for line in mine for cell in line[3:]] == cells


def test_a_file_gets_tables_and_sentences_unfolded() -> None:
    lines = printed(80, terminal=False).splitlines()
    assert [line.strip() for line in lines].count(SENTENCE.strip()) == 3
    assert len(lines) == 3 + 1 + len(ROWS), "title, what is said below, a sentence; the heads; a line a row"
    assert all(line == line.rstrip() for line in lines if "sentence" not in line)
    assert [line.split() for line in lines[2:5]] == [" ".join(row).split() for row in ROWS]


def test_a_long_cell_folds_at_spaces_in_a_terminal() -> None:
    file = io.StringIO()
    console = Output(file=file, force_terminal=True, width=40, color_system=None)
    table = Table("case", "what", "share", box=None)
    table.add_row("B1", SENTENCE, "12 %")
    console.print(table)
    lines = file.getvalue().splitlines()
    assert max(map(len, lines)) <= 40 and "12 %" in file.getvalue()
    assert file.getvalue().split().count("sentence") == 8
