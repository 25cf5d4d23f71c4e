"""Types that factories of formulas and kernels take."""

import numpy as np

Real = type[np.floating]  # the numpy type of a precision
