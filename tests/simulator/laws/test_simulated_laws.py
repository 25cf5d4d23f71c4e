"""A sample of the laws (tests/laws) on CUDA's kernels in plain Python: one row of each family, a law each."""

from __future__ import annotations

from types import ModuleType

import pytest
import test_law_energy as of_energy
import test_law_fall as of_fall
import test_law_momentum as of_momentum
from faults import fault_of
from lab import Lab
from law import LAWS, Law
from rows import ALL, Row

BODIES: tuple[ModuleType, ...] = (of_fall, of_momentum, of_energy)
SAMPLED = ("fall", "momentum", "angular momentum", "energy")  # a few steps each, that every family has


def sample() -> list[tuple[Law, Row]]:
    """Of each family its first row that no fault touches, with one law after the other."""
    laws = [law for law in LAWS if law.name in SAMPLED]
    families = list(dict.fromkeys(row.family for row in ALL))
    result = []
    for place, family in enumerate(families):
        law = laws[place % len(laws)]
        rows = [row for row in ALL if row.family == family and not law.absent(row)]
        result.append((law, next(row for row in rows if not fault_of(law.name, row, law.cases(row)[0], Lab()))))
    return result


@pytest.mark.parametrize(
    ("law", "row"), [pytest.param(*pair, id=f"{pair[0].name}-{pair[1].name}") for pair in sample()]
)
def test_a_law_holds_on_cuda(law: Law, row: Row) -> None:
    """The body of the law, with its own tolerance, in float32."""
    (body,) = [
        one for module in BODIES for one in vars(module).values() if getattr(one, "law", None) is law and callable(one)
    ]
    body(row, law.cases(row)[0], Lab("gpu", "float32"))
