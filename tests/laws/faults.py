"""Laws that a solver breaks today, and the bullet of the issue that names the fault: strict, so that a mended one
shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lab import Lab
from rows import Row


@dataclass(frozen=True)
class Fault:
    """`breaks(row, case, lab)`: whether the law fails there."""

    law: str
    reason: str
    breaks: Callable[[Row, str, Lab], bool]


def rows_of_neo_hookean(row: Row, case: str, lab: Lab) -> bool:
    """Whether tetrahedra are two neo-Hookean rows each."""
    return "neo-hookean" in row.name and row.solver == "xpbd"


NEO_HOOKEAN = "neo-Hookean under XPBD moves without load (issue 34, section 3, 1st bullet)"
OBJECTIVE = "damping that is not objective (issue 34, section 3, 2nd bullet)"
ENERGIES = "energies leave links and linear goals out (issue 34, section 3, 8th bullet)"
REBOUND = "a rigid body with restitution 0 rebounds (issue 34, section 3, 7th bullet)"
FAULTS: tuple[Fault, ...] = (
    Fault("rest", NEO_HOOKEAN, lambda row, case, lab: rows_of_neo_hookean(row, case, lab) and case == "unloaded"),
    Fault("fall", NEO_HOOKEAN, rows_of_neo_hookean),
    Fault("damping", NEO_HOOKEAN, lambda row, case, lab: rows_of_neo_hookean(row, case, lab) and case == "fall"),
    Fault(
        "damping", OBJECTIVE,
        lambda row, case, lab: case == "turn" and ("blocks" in row.name or row.solver == "newton"),
    ),
    Fault(
        "force", ENERGIES,
        lambda row, case, lab: row.name in ("soft_body, linked", "soft_sheet", "soft_body, linear", "soft_body, plastic"),
    ),
    Fault(
        "limit", ENERGIES,
        lambda row, case, lab: row.name in ("soft_sheet", "soft_body, linear", "soft_body, plastic"),
    ),
    Fault("limit", NEO_HOOKEAN, rows_of_neo_hookean),
    Fault("rebound", REBOUND, lambda row, case, lab: row.name == "rigid_body" and case == "0"),
)  # fmt: skip


def fault_of(law: str, row: Row, case: str, lab: Lab) -> str:
    """Why the law fails there, or ""."""
    return next((one.reason for one in FAULTS if one.law == law and one.breaks(row, case, lab)), "")
