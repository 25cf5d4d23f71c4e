"""What a deliberate mistake is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Mistake:
    """In `file`, the text `old`, which stands there once, becomes `new`. `tests`: near by, each a file somewhere under tests/ or one
    test of it (`test_bending.py::test_x`); some of them must fail with it."""

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.name} ({self.file})"

    def applied(self, text: str) -> str:
        """The file's text with the mistake. Raises ValueError where `old` does not stand in it exactly once."""
        if (found := text.count(self.old)) != 1:
            raise ValueError(f"{self}: its text stands {found} times in the file, and must stand there once")
        return text.replace(self.old, self.new)

    def read(self, root: Path = ROOT) -> str:
        """The file it is made in, as it is."""
        return (root / self.file).read_text(encoding="utf-8")


def path_of(test: str, root: Path = ROOT) -> str:
    """Where below `root` a test's file lies; the test as it was where there is no such file."""
    file, *name = test.split("::")
    found = [path.relative_to(root).as_posix() for path in (root / "tests").rglob(Path(file).name)]
    return "::".join([*found[:1], *name]) if found else f"tests/{test}"


def mistakes_of(table: dict[str, dict[str, dict[str, tuple[str, str]]]]) -> tuple[Mistake, ...]:
    """The mistakes of a table: file -> the tests that must notice them, apart by spaces -> name -> (old, new)."""
    return tuple(
        Mistake(name, file, old, new, tuple(tests.split()))
        for file, noticed_by in table.items()
        for tests, mistakes in noticed_by.items()
        for name, (old, new) in mistakes.items()
    )
