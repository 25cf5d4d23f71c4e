"""Types of the arguments of formulas and kernels."""

Real = type  # of a precision: np.float32 or np.float64
