"""The simulated model: scenes, their arrays, formulas, and the interface of a solver. No numba, no OpenGL, no
timing."""
