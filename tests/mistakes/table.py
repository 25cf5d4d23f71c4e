"""All deliberate mistakes."""

from __future__ import annotations

from .formulas import FORMULAS
from .kernels import KERNELS
from .reporting import REPORTING

MISTAKES = (*FORMULAS, *KERNELS, *REPORTING)
