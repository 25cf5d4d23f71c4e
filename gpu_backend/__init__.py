"""The lab on CUDA: numba.cuda, one thread per mass. Nothing here imports numba.cuda until a simulation is opened."""

import os

# read when numba.cuda is imported: that a small grid fills few multiprocessors is a fact here, not a mistake
os.environ.setdefault("NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS", "0")
