"""Where kernels differ in source, their machine code decides whether measurements are carried over."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import types
from test_kernel_keys import backend, changed, tree  # noqa: F401

from softlab.bench.keys.ask import keys_at
from softlab.bench.keys.carry import by_machine_code, groups_of
from softlab.bench.keys.machine_code import type_of, without_names
from softlab.bench.keys.record import DeviceArray
from softlab.bench.store.results import configuration
from softlab.model.base.digest import ROOT
from softlab.model.scene.scene import load_scene

LLVM = """define double @f(double %x) {
  %y = call double @llvm.sin.f64(double %x)
  ret double %y
}
declare double @llvm.sin.f64(double)
"""
PTX = """.version 8.0
.visible .entry _Z6kernelf(.param .f32 _Z6kernelf_param_0)
{
  mov.u32 %r1, %tid.x;
  ld.param.f32 %f1, [_Z6kernelf_param_0];
}
"""
SPRINGS = "model/formulas/springs.py"
LINE = "    scale = stiffness - stiffness_rest * inverse_length(squared_length(dx, dy))\n"
NAMED = """    square = squared_length(dx, dy)
    scale = stiffness - stiffness_rest * inverse_length(square)
"""


def test_only_names_that_a_text_defines_do_not_count() -> None:
    renamed = LLVM.replace("@f", "@g").replace("%y", "%z")
    assert without_names(LLVM) == without_names(renamed)
    assert without_names(LLVM) != without_names(LLVM.replace("sin", "cos"))
    assert without_names(LLVM) != without_names(LLVM.replace("ret double %y", "ret double %x"))
    assert without_names(PTX) == without_names(PTX.replace("kernel", "other1"))
    assert without_names(PTX) != without_names(PTX.replace("tid", "ctaid"))
    assert without_names(PTX) != without_names(PTX.replace("%f1,", "%f2,"))
    unread = PTX.replace("8.0\n", "8.0\n.common .global .align 8 .u64 _Z6kernelf__errcode__;\n")
    read = unread.replace("%tid.x", "_Z6kernelf__errcode__")
    assert without_names(unread) == without_names(PTX) and ".common" in without_names(read)


class Arrays(NamedTuple):
    position: Any
    lists: Any


def test_arrays_within_records_have_the_types_of_the_device() -> None:
    position = DeviceArray(np.zeros((2, 3), np.float32))
    of_record: Any = type_of(Arrays(position, (DeviceArray(np.zeros(2, np.int32)), 1)))
    assert of_record.instance_class is Arrays
    assert of_record.types[0] == types.Array(types.float32, 2, "C")
    assert of_record.types[1] == types.Tuple((types.Array(types.int32, 1, "C"), types.int64))


@pytest.mark.parametrize("old,new,same", [(LINE, NAMED, True), ("scale * dx", "scale * (dx + dx)", False)])
def test_machine_code_is_a_proof(
    tree: Path,  # noqa: F811
    backend: str,  # noqa: F811
    old: str,
    new: str,
    same: bool,
    request: pytest.FixtureRequest,
) -> None:
    if backend == "gpu":
        request.getfixturevalue("ptx_compiler")  # skips without one
    scene = load_scene("lab-grid").replace({"grid.rows": 8, "grid.columns": 8})
    told = {"grid": configuration(scene, backend=backend, kernel="launch" if backend == "gpu" else "fused")}
    changed(tree, SPRINGS, old, new)
    before, now = keys_at(tree, told), keys_at(ROOT, told)
    assert before["grid"][0] != now["grid"][0] and before["grid"][1] == now["grid"][1]
    assert not groups_of("sources", backend, before, now)
    found = by_machine_code(tree, "sources", backend, told, before, now)
    assert [group.configurations for group in found] == ([("grid",)] if same else [])
    assert all((group.proof, group.kernels) == ("machine code", now["grid"][0]) for group in found)
