"""The lab on CUDA: numba.cuda, one thread per mass. Nothing here imports numba.cuda until a simulation is opened."""
