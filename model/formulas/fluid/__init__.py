"""Position-based fluids: interaction of a particle with its neighbours.

M. Macklin and M. Mueller, "Position Based Fluids", SIGGRAPH 2013; kernels: M. Mueller, D. Charypar and M. Gross,
"Particle-Based Fluid Simulation for Interactive Applications", SCA 2003.
"""
