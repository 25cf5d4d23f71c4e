"""Figures of fluids: errors against known results, and times of the stages."""
