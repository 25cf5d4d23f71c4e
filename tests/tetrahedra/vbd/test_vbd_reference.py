"""A step of vertex block descent with many sweeps, against the judge's backward Euler by Newton's method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from vbd_scenes import BODY, end_state, moving, vbd_scene

from softlab.model.formulas.constraints.tetrahedron import MATERIALS

elements = pytest.importorskip("softlab.bench.reference.finite_elements", reason="the judge of tetrahedra is not there")
newton = pytest.importorskip(
    "softlab.bench.reference.finite_elements_newton", reason="the judge of tetrahedra is not there"
)


@pytest.mark.parametrize("apart,damping", [(1e-2, 0.0), (1e-2, 0.02)])
@pytest.mark.parametrize("material", MATERIALS)
def test_a_step_is_the_judges(material: str, apart: float, damping: float) -> None:
    """To what Newton's method leaves, and 150 sweeps: dampers are three times as stiff as the body."""
    scene = vbd_scene(BODY | {"material": material, "damping": damping}, gravity=0.0, iterations=150)
    found, part, begin = scene.tetrahedra_set, scene.tetrahedra["body"], moving(scene, apart)
    begin = replace(begin, velocity=begin.velocity * (apart / 0.01))
    body = elements.Body.of(found.position, found.tetrahedra, material, part.young_modulus, part.poisson_ratio)
    expected, _ = newton.implicit_euler(
        body,
        begin.position,
        begin.velocity,
        found.masses,
        begin.inverse_mass == 0,
        scene.method.dt,
        damping_time=damping,
    )
    way = np.abs(expected - begin.position).max()
    state = end_state(scene, start=begin)
    np.testing.assert_allclose(state.position, expected, atol=(1e-6 if damping else 1e-7) * way)
