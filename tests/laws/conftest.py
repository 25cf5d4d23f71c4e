"""Hands each test of a law the rows, cases and labs that it is asked in; `rest` marks what `pytest --rest` alone
runs."""

from __future__ import annotations

from typing import Any

import pytest
from faults import fault_of
from slices import asked, by_default, labs


def pytest_generate_tests(metafunc: Any) -> None:
    law = getattr(metafunc.function, "law", None)
    if law is None:
        return
    options, default, result = metafunc.config.option, by_default(law), []
    every = options.thorough or options.rest  # what runs then alone is not even collected without
    for row, case in asked(law):
        for lab, first in labs(law, row, case, (row, case) in default):
            if not (first or every):
                continue
            marks: list[Any] = [pytest.mark.gpu] if lab.backend == "gpu" else [] if first else [pytest.mark.rest]
            if fault := fault_of(law.name, row, case, lab):
                marks.append(pytest.mark.xfail(reason=fault, strict=True))
            name = "-".join(filter(None, [row.name, case, repr(lab)]))
            result.append(pytest.param(row, case, lab, marks=marks, id=name))
    metafunc.parametrize(("row", "case", "lab"), result)
