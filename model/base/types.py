"""Types that factories of formulas and kernels take."""

Real = type  # of a precision: np.float32 or np.float64
