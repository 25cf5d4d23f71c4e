"""Beams of cut voxels under every solver, and the tables of docs/method/tetrahedra.md, which are measured."""

from __future__ import annotations

from pathlib import Path

import pytest
import voxel_accuracy
from voxel_accuracy import SOLVERS, exact_sag, solver_sag


@pytest.mark.parametrize("method", SOLVERS.values(), ids=[str(method["solver"]) for method in SOLVERS.values()])
def test_solvers_rest_where_the_finite_elements_of_the_cut_mesh_do(method: dict[str, object], tmp_path: Path) -> None:
    """With its masses and fractions: what lacks of Timoshenko's sag is the mesh's."""
    sag, static = solver_sag(30.0, 2, method, tmp_path)
    assert sag == pytest.approx(static, rel=0.01) and 0.55 < static / exact_sag() < 0.75


def test_the_tables_of_the_page_are_the_measured_ones() -> None:
    text = voxel_accuracy.PAGE.read_text(encoding="utf-8")
    assert text == voxel_accuracy.page(), "stale: python -m tests.geometry.tetrahedra.voxel_accuracy"
