"""Versions of the code that measures and evaluates, which kernel keys do not cover; they are raised by hand.

Raise an experiment's number in a commit that changes the meaning of its samples or numbers, and only then; its earlier
measurements count as older from then on. A refactoring raises none.
"""

from __future__ import annotations

MEASURING = {  # experiment (the name of its summary) -> how it samples
    "sweep": 1, "accuracy": 1, "findings": 1, "costs": 1, "convergence": 1, "stability": 1, "hard cases": 1, "bar": 1,
    "bar: costs": 1, "tetrahedra": 1, "meshes of tetrahedra": 1, "fluids": 1, "fluids: truth": 1, "fluids: rest": 1,
    "busy": 1, "projections": 1, "throughput": 1, "vertices": 1, "scaling": 1,
}  # fmt: skip
JUDGING = {  # experiment -> its reference solution and what judges by it; those without have no errors of their own
    "sweep": 1, "accuracy": 1, "findings": 1, "convergence": 1, "stability": 1, "hard cases": 1, "bar": 1, "tetrahedra": 1,
    "meshes of tetrahedra": 1, "fluids: truth": 1,
}  # fmt: skip


def version_of(experiment: str) -> str:
    """`1.1`: how an experiment measures, and how it judges. Raises KeyError for one without a version."""
    return f"{MEASURING[experiment]}.{JUDGING.get(experiment, 0)}"
