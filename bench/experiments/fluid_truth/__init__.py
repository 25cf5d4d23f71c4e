"""Comparison of fluids with known results, and the cost of the runs: `softlab fluids --truth`."""
