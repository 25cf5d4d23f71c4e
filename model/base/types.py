"""Types of the arguments of formulas and kernels, and of what compiles them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

Index = int | np.integer
Number = float | np.floating
Real = type  # of a precision: np.float32 or np.float64
Feature = bool | int | str  # a constant of a variant
Features = Mapping[str, Feature]  # by their names in FEATURES of model/base/variant.py
FeatureSet = frozenset[tuple[str, Feature]]  # the same, as a key
Compile = Callable[[Callable], Callable]  # a decorator, which compiles a function
