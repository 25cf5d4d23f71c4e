"""Stability of runs: the largest stable step, the criterion of divergence, its causes and remedies."""
