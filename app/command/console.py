"""The console of the commands: prints sentences and tables whole, on any output."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.measure import Measurement
from rich.table import Column, Table

UNBOUNDED = 10_000  # characters: width of an unbounded line
SHORT = 24  # characters: shorter cells are names or numbers and stay in one line; longer ones may fold at spaces


class Output(Console):
    """A console that cuts no cell of a table, and folds nothing if its output is no terminal.

    Such an output gets one line per sentence and tables of full width, without trailing blanks. In a terminal that is
    narrower than a table, heads and sentences in cells are folded; if that is not enough, the columns are printed in
    blocks, each next to the names of its rows.
    """

    def print(self, *objects: Any, **how: Any) -> None:
        if not self.is_terminal:
            how.setdefault("soft_wrap", True)
        if len(objects) == 1 and isinstance(objects[0], Table):
            self._print_table(objects[0], how)
        else:
            super().print(*objects, **how)

    def _print_table(self, table: Table, how: dict[str, Any]) -> None:
        if table.title:  # a sentence, which may be longer than the table
            super().print(table.title, **how)
        max_width = self.width if self.is_terminal else UNBOUNDED
        for number, block in enumerate(self._blocks(table, max_width)):
            if number:
                super().print()
            block.width = Measurement.get(self, self.options.update(width=UNBOUNDED), block).maximum
            how |= {"crop": False, "soft_wrap": False}
            if self.is_terminal:
                super().print(block, **how)
                continue
            with self.capture() as captured:
                super().print(block, **how)
            self.out("\n".join(line.rstrip() for line in captured.get().splitlines()), highlight=False)

    def _blocks(self, table: Table, max_width: int) -> list[Table]:
        """Return the table in blocks whose lines have at most `max_width` characters, if no single column next to the names
        of the rows needs more."""
        whole = list(range(len(table.columns)))
        natural = [self._span(column)[1] for column in table.columns]
        if self._width_of(table, natural, whole) <= max_width:
            return [_part(table, natural, whole)]
        least = [self._span(column)[0] for column in table.columns]
        names = _names(table.columns)
        blocks: list[list[int]] = [[*names]]
        for index in whole[len(names) :]:
            if len(blocks[-1]) > len(names) and self._width_of(table, least, [*blocks[-1], index]) > max_width:
                blocks.append([*names])
            blocks[-1].append(index)
        return [_part(table, self._widened(table, least, natural, block, max_width), block) for block in blocks]

    def _span(self, column: Column) -> tuple[int, int]:
        """Return the minimum and maximum width of a column [characters]: with no cell cut, and with nothing folded."""
        options = self.options.update(width=UNBOUNDED)
        head = Measurement.get(self, options, column.header)
        cells = [Measurement.get(self, options, cell) for cell in column.cells]
        folds = not (column.no_wrap or column.justify == "right")
        least = [max(cell.minimum, SHORT) if folds and cell.maximum > SHORT else cell.maximum for cell in cells]
        return max([head.minimum, *least]), max([head.maximum, *(cell.maximum for cell in cells)])

    def _width_of(self, table: Table, widths: Sequence[int], columns: Sequence[int]) -> int:
        """Return the width of a table of these columns, including their padding."""
        options = self.options.update(width=UNBOUNDED)
        return Measurement.get(self, options, _part(table, widths, columns)).maximum

    def _widened(
        self, table: Table, least: Sequence[int], natural: Sequence[int], columns: Sequence[int], max_width: int
    ) -> list[int]:
        """Return the minimum widths plus the remaining characters, divided among the columns that can use them."""
        widths = list(least)
        spare = max_width - self._width_of(table, widths, columns)
        while spare > 0 and (tight := [index for index in columns if widths[index] < natural[index]]):
            for index in tight[:spare]:
                widths[index] += 1
            spare -= len(tight)
        return widths


def _names(columns: Sequence[Column]) -> list[int]:
    """Return the columns that name a row: those before the first number, or the first alone."""
    words = next((index for index, column in enumerate(columns) if column.justify == "right"), 1)
    return list(range(max(1, words)))


def _part(table: Table, widths: Sequence[int], columns: Sequence[int]) -> Table:
    """Return a table with these columns and widths only, without the title."""
    part = copy.copy(table)
    part.title = None
    part.columns = []
    for place, index in enumerate(columns):
        column = copy.copy(table.columns[index])
        column._index = place
        column.width, column.max_width, column.no_wrap, column.overflow = widths[index], None, False, "fold"
        part.columns.append(column)
    return part
