"""All deliberate mistakes."""

from __future__ import annotations

from .formulas import FORMULAS
from .formulas_of_bodies import BODIES
from .kernels import KERNELS
from .reporting import REPORTING
from .sharing import SHARING
from .tetrahedra import TETRAHEDRA

MISTAKES = (*FORMULAS, *BODIES, *KERNELS, *REPORTING, *TETRAHEDRA, *SHARING)
