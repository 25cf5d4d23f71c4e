"""Sums, small matrices and functions of the host whose bits are the same on every machine.

NumPy's `@`, `dot`, `einsum` and `linalg` use OpenBLAS or loops whose order of additions and use of fused multiply-adds
depend on the processor; so do its sine, exponential and power. Values that affect a state are computed here, by
additions, products, divisions and square roots of whole arrays, each rounded once (IEEE 754), in the order written.
"""
