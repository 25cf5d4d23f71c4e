"""The CUDA backend: numba.cuda, one thread per mass. numba.cuda is not imported until a simulation is opened."""

import os

# read when numba.cuda is imported: a small grid fills few multiprocessors on purpose
os.environ.setdefault("NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS", "0")
