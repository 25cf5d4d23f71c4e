"""Shape matching of grids, clusters and lattices: sums, goals, deformation, internal damping (factories: see
model/formulas).

M. Mueller, B. Heidelberger, M. Teschner and M. Gross, "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005.
"""
