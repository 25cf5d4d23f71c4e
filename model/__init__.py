"""What is simulated: scenes, their arrays, the formulas, the contract of a solver. No numba, no OpenGL, no timing."""
