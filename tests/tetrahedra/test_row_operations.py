"""Operations of a plan's tetrahedra against those that the formulas carry out, counted one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.model.base.variant import plain_formulas
from softlab.model.formulas.constraints import tetrahedron, voxel_volume
from softlab.model.formulas.constraints.tetrahedron import COROTATED, FIXED, HOOKEAN, MATERIALS

counted = [0]


class Counting(np.float64):
    """A number that counts its sums, differences, products and quotients."""


def _count(name: str) -> Any:
    own = getattr(np.float64, name)

    def operation(self: Counting, other: Any) -> Counting:
        counted[0] += 1
        return Counting(own(self, other))

    return operation


for _word in ("add", "sub", "mul", "truediv"):
    for _name in (f"__{_word}__", f"__r{_word}__"):
        setattr(Counting, _name, _count(_name))
Counting.__neg__ = lambda self: Counting(-float(self))  # type: ignore[assignment,method-assign,misc]  # a sign is free


def numbers(array: Any) -> Any:
    return tuple(Counting(x) if np.ndim(x) == 0 else numbers(x) for x in array)


def carried_out(project: Any, corners: Any, values: Any, multipliers: int) -> int:
    """Operations of one projection."""
    random = np.random.default_rng(3)
    now, before = (numbers(corners + 0.02 * random.normal(size=corners.shape)) for _ in range(2))
    start = numbers(random.normal(size=multipliers))
    counted[0] = 0
    project(now, before, numbers(np.ones(len(corners))), numbers(values), start, numbers(np.ones(3)))
    return counted[0]


@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("damped", [False, True])
@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.parametrize(
    "material,blocks", [(FIXED, False), (FIXED, True), (COROTATED, False), (COROTATED, True), (HOOKEAN, False)],
    ids=lambda word: ("rows", "blocks")[word] if isinstance(word, bool) else MATERIALS[word],
)  # fmt: skip
def test_rows_of_a_tetrahedron(material: int, blocks: bool, alone: bool, damped: bool, soft: bool) -> None:
    """To a tenth: roots and what a compiler takes out of three axes are counted by hand, a rotation at its usual length."""
    flags: dict[str, Any] = {
        "material": material, "damped": damped, "blocks": blocks, "soft": soft, "alone": alone,
    }  # fmt: skip
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    values = [1, 0, 0, 1, 0, 1, 0.1, 0.1, 1, 0.1]
    found = carried_out(plain_formulas(tetrahedron, Counting, flags).project, corners, values, tetrahedron.BLOCKS)
    assert tetrahedron.operations(item=8, **flags) == pytest.approx(found, rel=0.1)


@pytest.mark.parametrize("damped", [False, True])
def test_volume_of_a_voxel(damped: bool) -> None:
    """To a tenth, as above."""
    x, y, z = np.meshgrid([0.0, 1], [0.0, 1], [0.0, 1], indexing="ij")
    corners = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    project = plain_formulas(voxel_volume, Counting, {"damped": damped, "soft": True}).project
    found = carried_out(project, corners, [1 / 6, 0.1, 1, 0.1], 1)
    told = voxel_volume.OPERATIONS + damped * voxel_volume.OPERATIONS_DAMPER
    assert told == pytest.approx(found, rel=0.1)
