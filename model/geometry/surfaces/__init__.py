"""Surfaces that shapes are made of: a cup, and surface nets around lattice points."""
