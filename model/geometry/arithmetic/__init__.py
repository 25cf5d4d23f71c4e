"""Sums, small matrices and functions of the host whose bits are the same on every machine.

NumPy's `@`, `dot`, `einsum` and `linalg` go through OpenBLAS or through loops whose order of additions, and whose use of
fused multiply-adds, depends on the processor; so do its sine, exponential and power. What decides a state is computed here,
by additions, products, divisions and square roots of whole arrays, each rounded once (IEEE 754), in the order written.
"""
