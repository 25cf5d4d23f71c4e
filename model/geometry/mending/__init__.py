"""Repairs of a mesh before it is used: duplicate vertices, sheets that bound a volume, holes."""
