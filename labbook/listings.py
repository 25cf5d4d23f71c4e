"""Lines of the kernels that the book prints, read from their source files when the book is built."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

from softlab.model.base.digest import ROOT

GAP = "..."


@dataclass(frozen=True)
class Listing:
    """Lines of a function: from a line that begins with the first text of a pair to the next that begins with the second."""

    file: str
    function: str
    ranges: tuple[tuple[str, str], ...]

    def text(self) -> str:
        """Return the lines, dedented, with GAP for lines that are left out. Raises LookupError."""
        lines = (ROOT / self.file).read_text(encoding="utf-8").splitlines()
        selected: list[str] = []
        end = self._line(lines, f"def {self.function}(", 0)
        for first, last in self.ranges:
            begin = self._line(lines, first, end)
            if selected and begin > end:
                selected.append(lines[begin][: len(lines[begin]) - len(lines[begin].lstrip())] + GAP)
            end = self._line(lines, last, begin) + 1
            selected += lines[begin:end]
        return textwrap.dedent("\n".join(selected))

    def _line(self, lines: list[str], start: str, after: int) -> int:
        for number in range(after, len(lines)):
            if lines[number].lstrip().startswith(start):
                return number
        raise LookupError(f"{self.file} has no line that begins with {start!r}")


LISTINGS = {
    "gpu-mass": Listing(
        "gpu_backend/mass_spring/grid/kernels.py",
        "grid_pass",
        (
            ("j = np.int32(cuda.blockIdx.x", "i = np.int32(cuda.blockIdx.y"),
            ("if i < rows and j < columns", "px, py, vx, vy = move("),
            ("store_pair(new_position", "store_pair(new_velocity"),
        ),
    ),
    "cpu-row": Listing(
        "cpu_backend/mass_spring/grid/rows.py",
        "sum_row",
        (
            ("for j in range(blocks * BLOCK)", "if FEATURE.springs"),
            ("right_x, right_y = spring_acceleration_2d", "above_y[j] = below_y"),
        ),
    ),
    "cpu-taken": Listing(
        "cpu_backend/mass_spring/grid/persistent.py",
        "taken",
        (("border = BORDER", "return exchange(progress"),),
    ),
}


def listings() -> dict[str, dict[str, str]]:
    """Return name in the text -> the file and the lines of each listing."""
    return {name: {"file": listing.file, "text": listing.text()} for name, listing in LISTINGS.items()}
