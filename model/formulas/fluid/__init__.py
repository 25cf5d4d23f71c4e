"""Position-based fluids: what a particle and its neighbours do to one another.

M. Macklin and M. Mueller, "Position Based Fluids", SIGGRAPH 2013; kernels: M. Mueller, D. Charypar and M. Gross,
"Particle-Based Fluid Simulation for Interactive Applications", SCA 2003.
"""
