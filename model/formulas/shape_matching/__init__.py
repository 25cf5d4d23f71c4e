"""Shape matching of grids, clusters and lattices: sums, goals, what gives way, damping inside (the package above: factories).

M. Mueller, B. Heidelberger, M. Teschner and M. Gross, "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005.
"""
