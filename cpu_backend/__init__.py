"""The CPU backend: numba kernels, parallel over bands of rows."""

from softlab.cpu_backend.core import threads as threads  # first: it sets what numba reads when it is imported
