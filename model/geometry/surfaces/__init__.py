"""Surfaces that shapes are made of: a cup, and what surface nets lay around what is inside."""
